"""Elements of Mitsuba's XML scene format."""

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

import numpy as np

Element = ElementTree.Element


def plugin(tag: str, kind: str, children: Iterable[Element] = (), **attributes: str) -> Element:
    """Return an element such as ``<bsdf type="diffuse" id="...">``; attributes as for `put`."""
    element = ElementTree.Element(tag, {"type": kind, **attributes})
    element.extend(children)
    return element


def put(tag: str, name: str, value: Any) -> Element:
    """Return a parameter such as ``<float name="alpha" value="0.1"/>``.

    Numbers are written with as many digits as identify them.

    >>> ElementTree.tostring(put("rgb", "radiance", (1.0, 0.5, 0.1)))
    b'<rgb name="radiance" value="1.0, 0.5, 0.1" />'
    """
    return ElementTree.Element(tag, {"name": name, "value": words(value)})


def words(value: Any) -> str:
    """Return a value as the text of an attribute."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str | int):
        return str(value)
    return ", ".join(repr(float(number)) for number in np.ravel(value))


def transform(name: str, *steps: tuple[str, dict[str, Any]]) -> Element:
    """Return a transform of steps, such as ``("scale", {"x": 2.0})``, applied in this order."""
    element = ElementTree.Element("transform", {"name": name})
    for tag, attributes in steps:
        ElementTree.SubElement(element, tag, {key: words(value) for key, value in attributes.items()})
    return element


def document(root: Element, comment: str) -> bytes:
    """Return an XML file."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f"<!-- {comment.replace('--', '- -')} -->\n{text}\n".encode()
