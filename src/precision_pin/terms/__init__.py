"""Terms of the error model at a pose (displacements of places times random numbers), and their table."""

from precision_pin.terms.source import Dependence, Source
from precision_pin.terms.term import JointValue, Term, at_means

__all__ = ["Dependence", "JointValue", "Source", "Term", "at_means"]
