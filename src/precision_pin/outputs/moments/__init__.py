"""What is shown of moments."""
