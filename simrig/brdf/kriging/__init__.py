"""A BRDF known by scattered samples: kriging of its logarithms in half-difference coordinates."""
