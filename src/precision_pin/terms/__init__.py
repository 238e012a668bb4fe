"""What sources become at a pose: terms, displacements of places that random numbers multiply, in one table."""

from precision_pin.terms.term import Source, Term

__all__ = ["Source", "Term"]
