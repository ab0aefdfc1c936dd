"""How Sphinx builds the guide: `sphinx-build -W -b html docs docs/_build/html`. Nothing in it needs the network."""

import logging
import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "_ext"), str(Path(__file__).parents[1])]

logging.getLogger("traitlets").setLevel(logging.WARNING)  # one line for each notebook otherwise

project = "sdm-deflect"
author = "the authors of sdm-deflect"
project_copyright = f"2026, {author}"
version = release = installed("sdm-deflect")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinxcontrib.bibtex",
    "mathml",
    "notebooks",
    "docstrings",
    "signatures",
    "accessible",
    "fighter",
    "pages",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "examples", "tutorials/*.ipynb"]
templates_path = ["_templates"]
default_role = "code"

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3

nb_execution_mode = "force"  # what a page of the tutorials shows is what the package does now
nb_execution_in_temp = True
nb_execution_show_tb = True  # an error in a cell is a warning, which ends a build with -W
nb_merge_streams = True
nb_execution_timeout = 300  # seconds, of a cell
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # nothing from the network

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
bibtex_reference_style = "author_year"

suppress_warnings = ["ref.python"]  # two modules may have a class of the same name: the first is linked
autosummary_generate = True
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = "sdm-deflect"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["guide.css"]
html_copy_source = False
html_show_sphinx = False
