"""Fields of records: what the comment beside a field says becomes its description in the API pages."""

import inspect
import re

FIELD = re.compile(r"^    (\w+): (.*?)(?:  # (.*))?$")


def describe(app, what, name, obj, options, lines):
    """Give a record an Attributes section, unless its docstring has one."""
    if what != "class" or not (hasattr(obj, "_fields") or hasattr(obj, "__dataclass_fields__")):
        return
    if any(line.strip() in ("Attributes", "Parameters") for line in lines):
        return
    fields = [FIELD.match(line) for line in inspect.getsource(obj).splitlines()]
    said = [(found[1], found[3]) for found in fields if found and found[3]]
    if said:
        lines += ["", "Attributes", "----------"]
        for field, text in said:
            lines += [f"{field}", f"    {text}"]
        lines.append("")


def setup(app):
    """Connect what is defined here."""
    app.connect("autodoc-process-docstring", describe, priority=50)  # before sources.py and numpydoc
    return {"parallel_read_safe": True}
