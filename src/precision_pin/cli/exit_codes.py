"""Exit codes of the command line: a specification is not met or not judged, bad input, internal error.

A signal that ends the program gives 128 + its number.
"""

EXIT_SPEC, EXIT_INPUT, EXIT_INTERNAL = 1, 2, 3
