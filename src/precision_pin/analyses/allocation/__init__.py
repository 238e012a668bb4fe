"""Allocation of tolerances: the cheapest ones that keep limits of the pose error."""
