"""Kinds of arguments (their signatures), which choose the machine code of a kernel.

The kind of an array is its dtype, number of axes, memory layout and whether it is writable. The kind of a record is
its class and the kinds of its fields; that of an integer is its type. None is a kind of its own, so the compiler
removes the code for an argument that is None.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np


class Array(NamedTuple):
    """An array of numbers."""

    dtype: str
    ndim: int
    layout: str  # "C": the last axis is contiguous; "F": the first one is; "A": neither
    writeable: bool


class Record(NamedTuple):
    """A NamedTuple."""

    type: type
    fields: tuple["Kind", ...]


class Scalar(NamedTuple):
    """An integer."""

    dtype: str


Kind = Array | Record | Scalar | None


def kind_of(value: Any) -> Kind:
    """Return the kind of one argument.

    Raises
    ------
    TypeError
        It is not a NamedTuple, an array of numbers, an integer or None.
    """
    if value is None:
        return None
    if type(value) is int:
        return Scalar("int64")
    if isinstance(value, np.integer):
        return Scalar(value.dtype.name)
    if isinstance(value, np.ndarray):
        flags = value.flags
        if not flags.aligned or not value.dtype.isnative or value.dtype.kind not in "biuf":
            raise TypeError(f"a kernel takes aligned arrays of this machine's numbers, not of {value.dtype}")
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return Array(value.dtype.name, value.ndim, layout, flags.writeable)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return Record(type(value), tuple(map(kind_of, value)))
    raise TypeError(f"a kernel can't take {type(value).__name__}: {value!r}")


def describe(kind: Kind) -> str:
    """Return a kind as text; different kinds have different texts.

    >>> describe(kind_of(np.zeros((2, 3))))
    'float64[2C]'
    """
    if isinstance(kind, Record):
        return f"{kind.type.__module__}.{kind.type.__qualname__}({', '.join(map(describe, kind.fields))})"
    if isinstance(kind, Array):
        return f"{'' if kind.writeable else 'readonly '}{kind.dtype}[{kind.ndim}{kind.layout}]"
    return kind.dtype if kind else "None"


def types_of(value: Any) -> Iterator[type]:
    """Yield the types of an argument and of the fields of a record, in the order in which machine code reads them."""
    yield type(value)
    if isinstance(value, tuple):
        for field in value:
            yield from types_of(field)
