"""``displayed``: records of arrays that notebooks and ``help`` show in one line."""

from typing import Any, TypeVar

import numpy as np

FEW = 8  # an array or a tuple with at most so many elements is shown in full
Record = TypeVar("Record")


def displayed(record: type[Record]) -> type[Record]:
    """Give a NamedTuple a short ``repr``, and a signature with its annotations as they are written.

    Arrays and tuples of more than `FEW` elements are shown by type and shape. ``help`` would expand ``NDArray`` to
    ``numpy.ndarray[tuple[typing.Any, ...], numpy.dtype[...]]``, for each field.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> @displayed
    ... class Pair(NamedTuple):
    ...     t: np.ndarray
    ...     prim_id: np.ndarray
    >>> Pair(np.zeros((480, 640), np.float32), np.array([[1], [2]]))
    Pair(t=<float32 (480, 640)>, prim_id=array([[1], [2]]))
    """
    new: Any = record.__new__
    for annotations in (record.__annotations__, new.__annotations__):  # in both, NamedTuple wraps strings
        annotations |= {name: getattr(kind, "__forward_arg__", kind) for name, kind in annotations.items()}
    record.__repr__ = _line  # type: ignore[method-assign]
    return record


def _line(record: Any) -> str:
    fields = (f"{name}={_short(value)}" for name, value in zip(record._fields, record, strict=True))
    return f"{type(record).__name__}({', '.join(fields)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return " ".join(repr(value).split()) if value.size <= FEW else f"<{value.dtype} {value.shape}>"
    if type(value) is tuple and len(value) > FEW:
        return f"<tuple of {len(value):,}>"
    return repr(value)
