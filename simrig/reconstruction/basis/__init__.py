"""From a few samples and the basis of a database to a BRDF (thesis section 7.2)."""
