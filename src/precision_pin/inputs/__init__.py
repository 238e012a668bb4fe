"""Checks of arguments, arrays and files, and of the memory that a request needs."""
