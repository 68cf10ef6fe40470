"""Accuracy against cost, for every method."""
