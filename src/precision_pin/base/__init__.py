"""Foundations: errors, units, poses, arrays, files, memory, interrupts, compilation."""
