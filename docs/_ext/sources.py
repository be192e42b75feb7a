"""Sources: every [Key] of a page or a docstring becomes a link to its entry in references.md.

The files stay plain Markdown, and read as well without this.
"""

import re

CITED = re.compile(r"\[([A-Z][A-Za-z]+[0-9]{2,4}|PNG|sRGB)((?:, [^]\[]*)?)\](?![({])")
LINKED = re.compile(r"\[(\[[A-Z][^]\[]*\])\]\([./]*references\.md\)")  # as notebooks have it, for programs without this
CODE = re.compile(r"(^ *```.*?^ *```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"^- (\*\*\[(\w+)\]\*\*)", re.MULTILINE)
FILE_LINK = re.compile(r"\[(\w[\w-]*\.md)\]\(([./\w-]*\1)(#[\w-]+)?\)")  # [error.md](error.md): say the page's title


def label(key):
    """The target of a source's entry."""
    return f"source-{key.lower()}"


def link_page(app, docname, source):
    """Make each [Key] of a page a link, and each entry of the references a target."""
    if docname == "references":
        source[0] = ENTRY.sub(lambda entry: f"- ({label(entry[2])})=\n  {entry[1]}", source[0])
        return
    parts = CODE.split(source[0])
    for k in range(0, len(parts), 2):
        text = CITED.sub(lambda key: rf"[\[{key[1]}{key[2]}\]](#{label(key[1])})", LINKED.sub(r"\1", parts[k]))
        parts[k] = FILE_LINK.sub(r"[](\2\3)", text)
    source[0] = "".join(parts)


def link_docstring(app, what, name, obj, options, lines):
    """The same in docstrings, where they stand as [Key]_; and a bar is a bar there, as in |x|."""
    text = "\n".join(lines)
    parts = re.split(r"(``[^`]*``|^ *>>> .*$)", text, flags=re.MULTILINE)
    parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
    text = re.sub(r"\[(\w+)\]_", lambda key: f":ref:`[{key[1]}] <{label(key[1])}>`", "".join(parts))
    lines[:] = text.split("\n")


def setup(app):
    """Connect what is defined here."""
    app.connect("source-read", link_page)
    app.connect("autodoc-process-docstring", link_docstring, priority=100)  # before numpydoc
    return {"parallel_read_safe": True}
