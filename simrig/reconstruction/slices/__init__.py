"""From samples along slices to a BRDF."""
