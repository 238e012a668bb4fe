"""What everything rests on: errors, units, poses, arrays, files, memory, interrupts, compilation."""
