"""Sheets made, respelt and broken at random, and what must hold of each."""
