"""Checks of arguments, arrays, files, and of the memory that a request takes."""
