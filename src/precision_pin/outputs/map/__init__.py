"""Table and figure of a map."""
