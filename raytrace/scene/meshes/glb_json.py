"""Values of the JSON of a glTF file, each checked before it is used."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Record = dict[str, Any]


def entries(record: Record, key: str) -> list[Any]:
    """Return the list under a key; an empty one if the key is absent."""
    value = record.get(key, [])
    if not isinstance(value, list):
        raise ValueError(f"{key}: expected a list")
    return value


def record_in(record: Record, key: str) -> Record:
    """Return the object under a key; an empty one if the key is absent."""
    value = record.get(key, {})
    if not isinstance(value, dict):
        raise ValueError(f"{key}: expected an object")
    return value


def item(document: Record, name: str, index: Any) -> Record:
    """Return the object with that index of a list of the document."""
    items = entries(document, name)
    if type(index) is not int or not 0 <= index < len(items):
        raise ValueError(f"{name}[{str(index)[:40]}] does not exist")
    if not isinstance(items[index], dict):
        raise ValueError(f"{name}[{index}]: expected an object")
    return items[index]


def whole(record: Record, key: str, default: int | None = None) -> int:
    """Return the integer under a key."""
    value = record.get(key, default)
    if type(value) is not int or not 0 <= value < 2**53:
        raise ValueError(f"{key}: expected a whole number, got {str(value)[:40]}")
    return value


def numbers(record: Record, key: str, default: list[float]) -> NDArray[np.float64]:
    """Return as many numbers as the default has."""
    value = record.get(key, default)
    if not isinstance(value, list) or len(value) != len(default) or not all(type(x) in (int, float) for x in value):
        raise ValueError(f"{key}: expected {len(default)} numbers")
    return np.array(value, np.float64)


def extension(record: Record, name: str) -> Record | None:
    """Return the data of an extension for an object; None if there is none."""
    extensions = record_in(record, "extensions")
    return record_in(extensions, name) if name in extensions else None
