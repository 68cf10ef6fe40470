"""Displacement interpolation by optimal transport."""
