"""What is shown of a reliability analysis."""
