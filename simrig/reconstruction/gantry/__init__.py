"""From the slices of a gantry to a BRDF or a BTF (thesis sections 6.1 and 6.3.5)."""
