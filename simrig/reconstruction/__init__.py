"""Methods that turn a measurement into a reflectance."""
