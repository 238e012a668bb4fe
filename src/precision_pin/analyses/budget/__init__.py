"""Which tolerance makes how much of the error."""
