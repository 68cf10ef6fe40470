"""Mitsuba BSDFs that wrap a reflectance."""

if __name__ != "simrig.plugins":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.plugins', not as 'plugins'")
