"""precision-pin."""
