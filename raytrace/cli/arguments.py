"""Options of the command line, and parsers of their values; an error says what was expected and what was given."""

import contextlib
import sys
from argparse import ArgumentParser, ArgumentTypeError, BooleanOptionalAction, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NoReturn

from raytrace.cli import streams
from raytrace.cli.changes import set_option
from raytrace.cli.exposure import exposure
from raytrace.errors import printable, shortened
from raytrace.limits import LAYERS, LIGHT_LAYERS

LONGEST = 1000  # most characters of a message about an argument


class Parser(ArgumentParser):
    """An argument parser that can print its help and errors to any stream."""

    def __init__(self, program: str, about: str) -> None:
        super().__init__(
            prog=program, description=about, formatter_class=RawDescriptionHelpFormatter, allow_abbrev=False
        )

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, and exit with code 2."""
        with contextlib.suppress(OSError):  # the reader is gone
            self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: error: {shortened(printable(message), LONGEST)}")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Flush the output, such as the help, and exit."""
        if message:
            streams.say(message.rstrip())
        streams.flush()
        sys.exit(status)


def suggestion(word: str, known: Iterable[str]) -> str:
    """Suggest the known word that is closest, as the end of a message; "" where none is close.

    >>> suggestion("sobl", ["sobol", "stratified"])
    "; did you mean 'sobol'?"
    """
    from difflib import get_close_matches

    return "".join(f"; did you mean '{match}'?" for match in get_close_matches(word, list(known), 1))


def whole_number(low: int, high: int = 2**31 - 1) -> Callable[[str], int]:
    """Return a parser for whole numbers from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise ArgumentTypeError(f"expected a whole number from {low} to {high}, got '{text}'")
        return value

    return parse


def real_number(low: float, high: float) -> Callable[[str], float]:
    """Return a parser for numbers from `low` to `high`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:  # also true for NaN
            raise ArgumentTypeError(f"expected a number from {low:g} to {high:g}, got '{text}'")
        return value

    return parse


def whole_numbers(form: str, separator: str, lows: tuple[int, ...]) -> Callable[[str], tuple[int, ...]]:
    """Return a parser for whole numbers with a separator between them, each with a lower bound.

    >>> whole_numbers("WxH", "x", (1, 1))("640x480")
    (640, 480)
    """

    def parse(text: str) -> tuple[int, ...]:
        try:
            values = tuple(int(part) for part in text.lower().split(separator))
        except ValueError:
            values = ()
        if len(values) != len(lows) or any(value < low for value, low in zip(values, lows, strict=True)):
            bounds = ", ".join(str(low) for low in lows)
            raise ArgumentTypeError(f"expected {form}, whole numbers of at least {bounds}, got '{text}'")
        return values

    return parse


def one_of(*known: str) -> Callable[[str], str]:
    """Return a parser for one of several words; its error suggests the closest one."""

    def parse(text: str) -> str:
        if text not in known:
            raise ArgumentTypeError(f"expected {', '.join(known)}, got '{text}'{suggestion(text, known)}")
        return text

    return parse


def layers(text: str) -> tuple[str, ...]:
    """Parse names of layers, separated by commas."""
    return tuple(map(one_of(*LAYERS, *LIGHT_LAYERS), text.split(",")))


def memory(text: str) -> int:
    """Parse a number of bytes; the letters K, M, G and T stand for KiB, MiB, GiB and TiB.

    >>> memory("4G"), memory("1.5m")
    (4294967296, 1572864)
    """
    digits = text.lower().removesuffix("b").removesuffix("i")
    power = " kmgt".find(digits[-1:]) if digits[-1:] in tuple("kmgt") else 0
    try:
        value = float(digits[:-1] if power else digits) * 1024**power
    except ValueError:
        value = -1
    if not 1 <= value < 2**63:
        raise ArgumentTypeError(f"expected bytes, such as 500M or 4G, got '{text}'")
    return int(value)


RENDER_OPTIONS = (
    "spp",
    "size",
    "crop",
    "seed",
    "precision",
    "sampler",
    "integrator",
    "threads",
    "time_limit",
    "target_error",
    "aov",
    "max_memory",
)


def scene_options(parser: ArgumentParser) -> None:
    """Declare the scene file and the options for loading it."""
    parser.add_argument("scene", type=Path, help="scene file (JSON), or a mesh file")
    _load_options(parser)
    set_option(parser)


def _memory_option(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--max-memory", type=memory, metavar="SIZE", help="memory limit, such as 500M or 4G (default: what is free)"
    )


def _load_options(parser: ArgumentParser) -> None:
    _memory_option(parser)
    text = "allow the scene to read meshes below this folder, too (default: only below the scene file's folder)"
    parser.add_argument("--root", type=Path, metavar="DIR", help=text)


def render_options(parser: ArgumentParser) -> None:
    """Declare the options of ``render``."""
    scene_options(parser)
    _image_options(parser)


def demo_options(parser: ArgumentParser) -> None:
    """Declare the options of ``demo``: those of ``render``, without a scene."""
    _memory_option(parser)
    set_option(parser)
    _image_options(parser)


def _image_options(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("-o", "--output", type=Path, metavar="FILE", help=".png, .exr or .npz (default: ./<scene>.png)")
    add("--spp", type=whole_number(1), metavar="N", help="samples per pixel (default: the scene's)")
    size = whole_numbers("WxH", "x", (1, 1))
    add("--size", type=size, metavar="WxH", help="image size in pixels (default: the scene's)")
    window = whole_numbers("X,Y,W,H", ",", (0, 0, 1, 1))
    add("--crop", type=window, metavar="X,Y,W,H", help="render only W x H pixels, from column X and row Y")
    _integrator_option(parser)
    add("--seed", type=whole_number(0, 2**32 - 1), metavar="N", help="random seed (default: the scene's)")
    add("--precision", type=one_of("auto", "float32", "float64"), metavar="P", help="auto, float32 or float64")
    samplers = one_of("sobol", "stratified", "independent")
    add("--sampler", type=samplers, metavar="NAME", help="sobol, stratified or independent")
    add("--threads", type=whole_number(1, 4096), metavar="N", help="number of threads (default: one per core)")
    text = "render on the Dask cluster at this address, such as tcp://host:8786"
    add("--cluster", metavar="ADDRESS", help=text)
    text = "stop after this time and save the image so far"
    add("--time-limit", type=real_number(1e-3, 1e9), metavar="SECONDS", help=text)
    text = "adaptive sampling to this RMSE (sRGB, 0..1), with at most --spp samples"
    add("--target-error", type=real_number(1e-6, 0.999), metavar="E", help=text)
    text = "resume from <output>.checkpoint if it exists; otherwise create it"
    add("--resume", action="store_true", help=text)
    text = (
        f"layers to save in an .exr or .npz: {', '.join(LAYERS)}; with integrator path also {', '.join(LIGHT_LAYERS)}"
    )
    add("--aov", type=layers, default=(), metavar="A,B", help=text)
    text = "of a .png: multiply radiance by 2^STOPS; auto: so that the image is shown well"
    add("--exposure", type=exposure, default=0.0, metavar="STOPS", help=text)
    add("--quiet", action="store_true", help="no progress and no messages, only errors")
    add("--json", action="store_true", help="print one JSON object: path, seconds, statistics")


def explain_options(parser: ArgumentParser) -> None:
    """Declare the options of ``explain``."""
    scene_options(parser)
    _integrator_option(parser)


def _integrator_option(parser: ArgumentParser) -> None:
    text = "direct: light straight from the lights; path: all the light (default: the scene's)"
    parser.add_argument("--integrator", choices=("direct", "path"), help=text)


def warmup_options(parser: ArgumentParser) -> None:
    """Declare the options of ``warmup``."""
    text = "scene files (JSON): compile only what these need (default: what all scenes without path tracing need)"
    parser.add_argument("scenes", type=Path, nargs="*", metavar="scene", help=text)
    text = "path: compile the kernels of path tracing too"
    parser.add_argument("--integrator", choices=("direct", "path"), default="direct", help=text)
    _load_options(parser)


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


def report_options(parser: ArgumentParser) -> None:
    """Declare the options of ``report``."""
    add = parser.add_argument
    add("scene", type=Path, nargs="?", help="scene file (JSON) to measure speed and error of")
    _load_options(parser)
    set_option(parser)
    add("--hard-cases", action="store_true", help="instead of a scene, test rays that break ray tracers")
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the report")
    add("--reference", type=Path, metavar="FILE", help="reference image, .exr or .npz (default: rendered, and kept)")
    add("--budget", type=real_number(1, 1e9), default=60.0, metavar="SECONDS", help="measuring time (default: 60)")
    size = whole_numbers("WxH", "x", (1, 1))
    add("--size", type=size, metavar="WxH", help="image size in pixels (default: the scene's)")


def conformance_options(parser: ArgumentParser) -> None:
    """Declare the options of ``conformance``."""
    add = parser.add_argument
    add("suite", type=Path, nargs="?", metavar="DIR", help="folder of the suite, to judge images of its scenes")
    add("--images", type=Path, metavar="DIR", help="folder of the images to judge: .exr, .npz or .png")
    text = (
        "without --images: folder to write the suite into; with it: folder of the report (default: that of the images)"
    )
    add("-o", "--output", type=Path, metavar="DIR", help=text)


def export_options(parser: ArgumentParser) -> None:
    """Declare the options of ``export``."""
    scene_options(parser)
    add = parser.add_argument
    add("--to", type=one_of("mitsuba", "pbrt"), required=True, metavar="NAME", help="mitsuba (3) or pbrt (v4)")
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the scene, its meshes and images")
    text = "replace what the other renderer cannot express by what is closest, with a warning for each"
    add("--approximate", action="store_true", help=text)
