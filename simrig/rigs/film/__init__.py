"""A gantry that films: slices as videos, and what they become (thesis section 6.2)."""
