"""Rigs that record pictures as their sensor would, and make values of them."""
