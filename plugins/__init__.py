"""Mitsuba BSDFs that wrap a BRDF or BTF, and integrators.

Importing this package is enough: its plugins are there in the Mitsuba variant that is set, and in
every one that is set later.
"""

if __name__ != "simrig.plugins":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.plugins', not as 'plugins'")

from simrig.plugins.make import make_bsdf, make_btf, one_line_errors
from simrig.plugins.register import follow_variants

__all__ = ["make_bsdf", "make_btf", "one_line_errors"]

follow_variants()
