"""What is shown of an exact law."""
