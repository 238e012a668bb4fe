"""Table and figure of a reliability analysis."""
