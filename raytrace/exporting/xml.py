"""Elements of Mitsuba's XML scene format."""

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

Element = ET.Element


def plugin(tag: str, kind: str, children: Iterable[Element] = (), **attributes: str) -> Element:
    """Return an element such as ``<bsdf type="diffuse" id="...">``; attributes as for `put`."""
    element = ET.Element(tag, {"type": kind, **attributes})
    element.extend(children)
    return element


def put(tag: str, name: str, value: Any) -> Element:
    """Return a parameter such as ``<float name="alpha" value="0.1"/>``.

    Numbers are written with as many digits as identify them.

    >>> ET.tostring(put("rgb", "radiance", (1.0, 0.5, 0.1)))
    b'<rgb name="radiance" value="1.0, 0.5, 0.1" />'
    """
    return ET.Element(tag, {"name": name, "value": words(value)})


def words(value: Any) -> str:
    """Return a value as the text of an attribute."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str | int):
        return str(value)
    return ", ".join(repr(float(number)) for number in np.ravel(value))


def transform(name: str, *steps: tuple[str, dict[str, Any]]) -> Element:
    """Return a transform of steps, such as ``("scale", {"x": 2.0})``, applied in this order."""
    element = ET.Element("transform", {"name": name})
    for tag, attributes in steps:
        ET.SubElement(element, tag, {key: words(value) for key, value in attributes.items()})
    return element


def document(root: Element, comment: str) -> bytes:
    """Return an XML file."""
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return f"<!-- {comment.replace('--', '- -')} -->\n{text}\n".encode()
