"""Figures of ISO 9283:1998: of measured cycles, and their law over built robots and over tests."""
