"""A room switched between BTF and BRDF."""
