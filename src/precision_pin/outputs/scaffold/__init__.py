"""The sheet to begin with."""
