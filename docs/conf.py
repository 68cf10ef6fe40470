"""The manual as a site: ``make docs`` builds it into ``output/docs``."""

from importlib.metadata import version as version_of
from pathlib import Path

project = "simrig"
author = "the simrig developers"
copyright = "2026, the simrig developers"
release = version = version_of("simrig")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinxcontrib.mermaid",
]
html_theme = "furo"
html_title = "simrig"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache"  # a notebook that did not change is not run again
nb_execution_cache_path = str(Path(__file__).parents[1] / "output" / "notebooks")
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
myst_fence_as_directive = ["mermaid"]  # as other readers of Markdown take such a block
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
