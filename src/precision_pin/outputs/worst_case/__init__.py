"""What is shown of a worst case."""
