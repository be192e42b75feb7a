"""Sphinx builds the site from this folder: ``sphinx-build -W -n docs site``, after ``pip install ".[docs]"``.

Nothing is fetched, neither while it is built nor by the pages: MathJax comes from a package.
"""

import sys
from importlib.resources import files
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]  # the documents are about this folder, installed or not

import raytrace  # noqa: E402

project = "raytrace"
author = copyright = "the raytrace authors"  # noqa: A001
release = version = raytrace.__version__

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "fields", "sources"]
exclude_patterns = ["pictures"]

# --- pages ------------------------------------------------------------------------------------------------------------

html_theme = "furo"
html_title = f"raytrace {release}"
html_static_path = ["_static", str(files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg.js")]
html_css_files = ["site.css"]
mathjax_path = "tex-svg.js"  # glyphs as curves: one file, no fonts
pygments_style, pygments_dark_style = "default", "github-dark"

# --- Markdown and notebooks -------------------------------------------------------------------------------------------

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "cache"  # beside the pages; an empty folder runs all notebooks
nb_execution_timeout = 120  # seconds a cell
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True

# --- the public names -------------------------------------------------------------------------------------------------

nitpicky = True
autodoc_typehints = "none"  # numpydoc sections state them, with shapes and units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
