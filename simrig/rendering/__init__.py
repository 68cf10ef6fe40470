"""Scenes to pictures: rendering, samplers, pixel samples, environments."""
