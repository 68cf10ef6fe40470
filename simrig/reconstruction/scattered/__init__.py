"""From samples at any directions to a BRDF."""
