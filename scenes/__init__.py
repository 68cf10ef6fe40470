"""Pure functions that return Mitsuba scene dictionaries; nothing is rendered here."""

if __name__ != "simrig.scenes":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.scenes', not as 'scenes'")
