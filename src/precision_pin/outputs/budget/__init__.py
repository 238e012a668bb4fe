"""What is shown of a budget."""
