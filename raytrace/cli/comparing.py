"""The command ``compare``: numbers of two images, limits, and the z-test."""

from argparse import ArgumentError, ArgumentParser, BooleanOptionalAction, Namespace
from pathlib import Path
from typing import Any

import raytrace
from raytrace.cli import streams
from raytrace.cli.arguments import real_number
from raytrace.errors import RaytraceError, printable


def compare_options(parser: ArgumentParser) -> None:
    """Declare the options of ``compare``; its limits are the fields of ``raytrace.image.metrics.Limits``."""
    add = parser.add_argument
    add("image", type=Path, help="image to compare: .exr, .npz or .png")
    add("reference", type=Path, help="reference image")
    limit = real_number(0, float("inf"))
    add("--max-rmse", type=limit, metavar="X", help="root mean square error, linear radiance")
    add("--max-rmse-srgb", type=limit, metavar="X", help="root mean square error in sRGB, clipped to 0..1")
    add("--max-relative-mse", type=limit, metavar="X", help="mean squared error, relative to each value")
    add("--min-ssim", type=real_number(-1, 1), metavar="X", help="structural similarity; 1 means equal")
    add("--max-bias", type=limit, metavar="X", help="relative difference of a channel's mean")
    add("--max-worst-tile", type=limit, metavar="X", help="error of the worst 8 x 8 tile")
    add("--max-outliers", type=real_number(0, 1), metavar="X", help="fraction of pixels that are outliers")
    add("--max-mrse", type=limit, metavar="X", help="mean relative squared error, as pbrt has it")
    add("--max-flip", type=real_number(0, 1), metavar="X", help="mean FLIP, as shown on a screen; 0 means equal")
    add("--max-hdr-flip", type=real_number(0, 1), metavar="X", help="mean HDR-FLIP, of the light itself")
    text = "measure FLIP and HDR-FLIP, or do not (default: if flip-evaluator is installed)"
    add("--flip", action=BooleanOptionalAction, help=text)
    text = "fail if the images differ by more than their noise; both files must have variances (.exr, .npz)"
    add("--z-test", action="store_true", help=text)
    text = "of the z-test: probability that images which differ by noise only fail (default: 0.01)"
    add("--alpha", type=real_number(1e-12, 0.5), metavar="P", help=text)
    add("--json", action="store_true", help="print one JSON object")


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
