"""What sources become at a pose: terms, displacements of places that random numbers multiply, in one table."""

from precision_pin.terms.source import Dependence, Source
from precision_pin.terms.term import Term

__all__ = ["Dependence", "Source", "Term"]
