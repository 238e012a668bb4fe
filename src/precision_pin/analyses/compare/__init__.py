"""Several error models side by side, with the same robots."""
