"""How rarely a specification is missed."""
