"""Table of an allocation, and its sheet."""
