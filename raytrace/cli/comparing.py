"""The command ``compare``: numbers of two images, limits, and the z-test."""

from argparse import ArgumentError, Namespace
from typing import Any

import raytrace
from raytrace.cli import streams
from raytrace.errors import RaytraceError, printable


def compared(args: Namespace) -> bool:
    """Compare two images, print the result, and return whether all limits are met."""
    from raytrace.image import flip
    from raytrace.image.metrics import Limits, violations

    limits = Limits(**{name: getattr(args, name) for name in Limits._fields})
    if args.flip is not False:
        for name in ("max_flip", "max_hdr_flip"):
            if getattr(limits, name) is not None:
                flip.required(f"--{name.replace('_', '-')}")
        if args.flip:
            flip.required("--flip")
    elif limits.max_flip is not None or limits.max_hdr_flip is not None:
        raise ArgumentError(None, "--no-flip: cannot be combined with --max-flip or --max-hdr-flip")
    if args.alpha is not None and not args.z_test:
        raise ArgumentError(None, "--alpha: is the level of --z-test; add that option")
    try:
        test = _tested(args) if args.z_test else {}
        measured = raytrace.compare(args.image, args.reference, flip=args.flip)
    except RaytraceError:
        raise
    except ValueError as error:  # the sizes differ
        streams.say(printable(f"{args.image}, {args.reference}: {error}"))
        return False
    broken = violations(measured, limits) + [reason for reason in [test.pop("reason", "")] if reason]
    if args.flip is None and not flip.available():
        streams.say(flip.MISSING)
    numbers = {name: value for name, value in measured._asdict().items() if value is not None}
    _print(args, numbers, test, broken)
    for line in broken:
        streams.say(line)
    return not broken


def _tested(args: Namespace) -> dict[str, Any]:
    from raytrace.image.significance import ALPHA, z_test

    found = z_test(args.image, args.reference, ALPHA if args.alpha is None else args.alpha)
    return {"passed": found.passed} | found._asdict()


def _print(args: Namespace, numbers: dict[str, Any], test: dict[str, Any], broken: list[str]) -> None:
    if args.json:
        streams.out(streams.json_text(numbers | ({"z_test": test} if test else {}) | {"violations": broken}))
        return
    rows = numbers | {f"z_test.{name}": value for name, value in test.items()}
    for name, value in rows.items():
        each = value if isinstance(value, tuple) else (value,)
        texts = [str(one) if isinstance(one, str | bool) else f"{one:.6g}" for one in each]
        streams.out(f"{name:<14} {' '.join(texts)}")
