"""Sphinx builds the site from this folder: ``sphinx-build -W -n docs site``, after ``pip install ".[docs]"``.

Nothing is fetched, neither while it is built nor by the pages: MathJax comes from a package.
"""

import re
import sys
from importlib.resources import files
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # the documents are about this folder, installed or not

import raytrace  # noqa: E402

project = "raytrace"
author = "The raytrace authors"
release = version = raytrace.__version__

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.mathjax"]
exclude_patterns = ["pictures"]

# --- pages ------------------------------------------------------------------------------------------------------------

html_theme = "furo"
html_title = f"raytrace {release}"
html_static_path = ["_static", str(files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg.js")]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
mathjax_path = "tex-svg.js"  # glyphs as curves: one file, no fonts
pygments_style, pygments_dark_style = "default", "github-dark"

# --- Markdown and notebooks -------------------------------------------------------------------------------------------

myst_enable_extensions = ["amsmath", "attrs_inline", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "cache"  # in the folder of the site's doctrees; an empty one runs all
nb_execution_timeout = 120  # seconds a cell
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True

# --- the public names -------------------------------------------------------------------------------------------------

autodoc_typehints = "none"  # numpydoc sections tell them, with shapes and units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
nitpicky = True

# --- sources ----------------------------------------------------------------------------------------------------------

CITED = re.compile(r"\[([A-Z][A-Za-z]+[0-9]{2,4}|PNG|sRGB)((?:, [^]\[]*)?)\](?![(:{])")
CODE = re.compile(r"(^ *```.*?^ *```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"^- (\*\*\[(\w+)\]\*\*)", re.MULTILINE)


def label(key):
    """The target of a source's entry."""
    return f"source-{key.lower()}"


def link_sources(app, docname, source):
    """Make each [Key] of a page a link to its entry in references.md, and each entry there a target."""
    if docname == "references":
        source[0] = ENTRY.sub(lambda entry: f"- ({label(entry[2])})=\n  {entry[1]}", source[0])
    else:
        parts = CODE.split(source[0])
        parts[::2] = [CITED.sub(lambda key: rf"[\[{key[1]}{key[2]}\]](#{label(key[1])})", text) for text in parts[::2]]
        source[0] = "".join(parts)


def name_sources(app, what, name, obj, options, lines):
    """The same in docstrings, where they stand as [Key]_."""
    lines[:] = [re.sub(r"\[(\w+)\]_", lambda key: f":ref:`[{key[1]}] <{label(key[1])}>`", line) for line in lines]


def setup(app):
    """Connect what is defined here."""
    app.connect("source-read", link_sources)
    app.connect("autodoc-process-docstring", name_sources, priority=100)  # before numpydoc
