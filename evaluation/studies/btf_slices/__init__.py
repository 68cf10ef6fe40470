"""BTFs from few images."""
