"""Methods that turn a measurement into a BRDF."""
