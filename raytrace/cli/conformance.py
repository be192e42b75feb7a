"""The command ``conformance``."""

from argparse import ArgumentError, ArgumentParser, Namespace
from pathlib import Path

from raytrace.cli import streams
from raytrace.errors import printable


def conformance_options(parser: ArgumentParser) -> None:
    """Declare the options of ``conformance``."""
    add = parser.add_argument
    add("suite", type=Path, nargs="?", metavar="DIR", help="folder of the suite, to judge images of its scenes")
    add("--images", type=Path, metavar="DIR", help="folder of the images to judge: .exr, .npz or .png")
    text = (
        "without --images: folder to write the suite into; with it: folder of the report (default: that of the images)"
    )
    add("-o", "--output", type=Path, metavar="DIR", help=text)


def conformance(args: Namespace) -> bool:
    """Write the suite, or judge images; return whether all is well."""
    if args.suite is None and args.images is None and args.output is not None:
        from raytrace.conformance.writing import write_suite

        paths = write_suite(args.output)
        streams.out(printable(paths[-1]))
        return True
    if args.suite is None or args.images is None:
        text = "expected -o DIR to write the suite, or DIR --images IMAGES to judge images"
        raise ArgumentError(None, f"conformance: {text}")
    from raytrace.conformance.judging import judge
    from raytrace.conformance.page import text as text_of
    from raytrace.conformance.page import write_judgement
    from raytrace.output_folder import check_folder

    folder = args.output or args.images
    judgement = judge(args.suite, args.images)
    check_folder(folder)
    streams.out(text_of(judgement))
    for path in write_judgement(judgement, args.images, folder):
        streams.out(printable(path))
    return judgement.ok
