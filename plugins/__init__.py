"""Mitsuba BSDFs that wrap a BRDF."""

if __name__ != "simrig.plugins":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.plugins', not as 'plugins'")

from simrig.plugins.make import make_bsdf, make_btf, one_line_errors

__all__ = ["make_bsdf", "make_btf", "one_line_errors"]
