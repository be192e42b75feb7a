"""Measure the overhead of a kernel call without rays, compared with Numba's own dispatcher."""

import numba
import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster

from raytrace.native import compiler
from raytrace.rendering.kernels import Picture, needs

CALLS = 2000


def main() -> None:
    args = parser(__doc__).parse_args()
    found = begin()
    compiler.teach()
    rows = []
    for kernel, kinds in needs(Picture("float32", "sobol", lit=True)):
        arguments = [empty(kind) for kind in kinds]
        dispatcher = numba.njit(nogil=True, error_model="numpy", _nrt=False)(kernel.function)
        pair = {"raytrace": kernel, "Numba": dispatcher}
        seconds = interleave({name: repeated(call, arguments) for name, call in pair.items()}, args.rounds)
        each = {name: float(np.median(times)) / CALLS * 1e9 for name, times in seconds.items()}
        ratio = times_faster(seconds["raytrace"], seconds["Numba"])
        rows.append([kernel.__name__, arrays(kinds), *each.values(), ratio])
    show("Nanoseconds per call:\n")
    header = ["kernel", "arrays", "raytrace", "Numba", "times faster"]
    table(header, rows)
    finish(args, found, [dict(zip(header, row, strict=True)) for row in rows])


def empty(value):
    """Return arguments of the same signature, without rays."""
    if isinstance(value, np.ndarray):
        return value[:0] if value.ndim == 1 and len(value) > 4 else value
    return type(value)(*map(empty, value)) if isinstance(value, tuple) else value


def arrays(value) -> int:
    if isinstance(value, np.ndarray):
        return 1
    return sum(map(arrays, value)) if isinstance(value, tuple | list) else 0


def repeated(call, arguments):
    def many():
        for _ in range(CALLS):
            call(*arguments)

    return many


if __name__ == "__main__":
    main()
