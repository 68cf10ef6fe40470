"""The whole 41 × 41 × 180 × 180 array by every method."""
