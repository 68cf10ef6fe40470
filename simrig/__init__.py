"""simrig: a virtual laboratory for measuring how materials look."""

__version__ = "0.1.0"
