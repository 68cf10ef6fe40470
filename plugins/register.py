"""Registration of the simrig BSDFs, once per Mitsuba variant."""


def register() -> None:
    """Register every simrig plugin in the current variant."""
