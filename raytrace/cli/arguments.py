"""Options of the command line: each parser of a value says what it expected and what it got."""

import contextlib
import sys
from argparse import ArgumentParser, ArgumentTypeError, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NoReturn

from raytrace.cli import streams
from raytrace.errors import printable, shortened
from raytrace.limits import LAYERS

LONGEST = 1000  # characters of a message about an argument


class Parser(ArgumentParser):
    """A parser whose help and errors fit into any stream."""

    def __init__(self, program: str, about: str) -> None:
        super().__init__(
            prog=program, description=about, formatter_class=RawDescriptionHelpFormatter, allow_abbrev=False
        )

    def error(self, message: str) -> NoReturn:
        """Say what is wrong, and leave with exit code 2."""
        with contextlib.suppress(OSError):  # nobody reads it
            self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: error: {shortened(printable(message), LONGEST)}")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Leave; what was printed, as the help, is written first."""
        if message:
            streams.say(message.rstrip())
        streams.flush()
        sys.exit(status)


def suggestion(word: str, known: Iterable[str]) -> str:
    """Name the known word that was probably meant, as the end of a message; nothing where none is close.

    >>> suggestion("sobl", ["sobol", "stratified"])
    "; did you mean 'sobol'?"
    """
    from difflib import get_close_matches

    return "".join(f"; did you mean '{match}'?" for match in get_close_matches(word, list(known), 1))


def whole_number(low: int, high: int = 2**31 - 1) -> Callable[[str], int]:
    """Parse a whole number from `low` to `high`."""

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
    """Parse a number from `low` to `high`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:  # NaN is out of any range
            raise ArgumentTypeError(f"expected a number from {low:g} to {high:g}, got '{text}'")
        return value

    return parse


def whole_numbers(form: str, separator: str, lows: tuple[int, ...]) -> Callable[[str], tuple[int, ...]]:
    """Parse whole numbers with a separator between them, each at least its own lower bound.

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
    """Parse one of a few words, with a suggestion for a misspelt one."""

    def parse(text: str) -> str:
        if text not in known:
            raise ArgumentTypeError(f"expected {', '.join(known)}, got '{text}'{suggestion(text, known)}")
        return text

    return parse


def layers(text: str) -> tuple[str, ...]:
    """Parse names of layers with commas between them."""
    return tuple(map(one_of(*LAYERS), text.split(",")))


def memory(text: str) -> int:
    """Parse a number of bytes, or of KiB, MiB, GiB or TiB by a letter.

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
        raise ArgumentTypeError(f"expected bytes, as 500M or 4G, got '{text}'")
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
    """Declare a scene, where its meshes may lie, and what memory it may take."""
    parser.add_argument("scene", type=Path, help="scene file (JSON)")
    _load_options(parser)


def _memory_option(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--max-memory", type=memory, metavar="SIZE", help="bytes, as 500M or 4G (default: what is free)"
    )


def _load_options(parser: ArgumentParser) -> None:
    _memory_option(parser)
    text = "a folder whose files the scene may read too (default: only those below its own)"
    parser.add_argument("--root", type=Path, metavar="DIR", help=text)


def render_options(parser: ArgumentParser) -> None:
    """Declare the options of ``render``."""
    scene_options(parser)
    _image_options(parser)


def demo_options(parser: ArgumentParser) -> None:
    """Declare the options of ``demo``: those of ``render``, without a scene."""
    _memory_option(parser)
    _image_options(parser)


def _image_options(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("-o", "--output", type=Path, metavar="FILE", help=".png, .exr or .npz (default: ./<scene>.png)")
    add("--spp", type=whole_number(1), metavar="N", help="samples per pixel (default: the scene's)")
    add("--size", type=whole_numbers("WxH", "x", (1, 1)), metavar="WxH", help="film, pixels (default: the scene's)")
    window = whole_numbers("X,Y,W,H", ",", (0, 0, 1, 1))
    add("--crop", type=window, metavar="X,Y,W,H", help="only these pixels, from column X and row Y on")
    text = "direct: light straight from the lights; path: all the light (default: the scene's)"
    add("--integrator", choices=("direct", "path"), help=text)
    add("--seed", type=whole_number(0, 2**32 - 1), metavar="N", help="random numbers (default: the scene's)")
    add("--precision", type=one_of("auto", "float32", "float64"), metavar="P", help="auto, float32 or float64")
    samplers = one_of("sobol", "stratified", "independent")
    add("--sampler", type=samplers, metavar="NAME", help="sobol, stratified or independent")
    add("--threads", type=whole_number(1, 4096), metavar="N", help="(default: one a core); no effect on the picture")
    text = "a Dask scheduler, as tcp://host:8786: its workers draw"
    add("--cluster", metavar="ADDRESS", help=text)
    add("--time-limit", type=real_number(1e-3, 1e9), metavar="SECONDS", help="stop then and save what is finished")
    add("--target-error", type=real_number(1e-6, 0.999), metavar="E", help="RMSE (sRGB, 0..1) to reach; --spp caps it")
    text = "go on from what a render of the same picture kept beside it, or keep it from the start"
    add("--resume", action="store_true", help=text)
    add("--aov", type=layers, default=(), metavar="A,B", help=f"layers of an .exr or .npz: {', '.join(LAYERS)}")
    add("--exposure", type=real_number(-100, 100), default=0.0, metavar="STOPS", help="of a .png: light x 2^STOPS")
    add("--quiet", action="store_true", help="no progress and no messages, only errors")
    add("--json", action="store_true", help="print one JSON object: path, seconds, statistics")


def compare_options(parser: ArgumentParser) -> None:
    """Declare the options of ``compare``: the fields of ``raytrace.image.metrics.Limits`` are the limits."""
    add = parser.add_argument
    add("image", type=Path, help="picture to judge: .exr, .npz or .png")
    add("reference", type=Path, help="picture to judge it by")
    limit = real_number(0, float("inf"))
    add("--max-rmse", type=limit, metavar="X", help="root of the mean squared difference, linear light")
    add("--max-rmse-srgb", type=limit, metavar="X", help="the same on a screen: sRGB, clipped to 0..1")
    add("--max-relative-mse", type=limit, metavar="X", help="mean squared difference, relative to each value")
    add("--min-ssim", type=real_number(-1, 1), metavar="X", help="structural similarity, 1 is equal")
    add("--max-bias", type=limit, metavar="X", help="relative difference of a channel's mean")
    add("--max-worst-tile", type=limit, metavar="X", help="difference of the worst 8 x 8 tile")
    add("--max-outliers", type=real_number(0, 1), metavar="X", help="share of pixels that stand out")
    add("--json", action="store_true", help="print one JSON object")


def report_options(parser: ArgumentParser) -> None:
    """Declare the options of ``report``."""
    add = parser.add_argument
    add("scene", type=Path, nargs="?", help="scene file (JSON) whose speed is measured against its error")
    _load_options(parser)
    add("--hard-cases", action="store_true", help="rays that break ray tracers, judged exactly, instead of a scene")
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the report")
    add("--reference", type=Path, metavar="FILE", help=".exr or .npz to judge by (default: one is drawn, and kept)")
    add("--budget", type=real_number(1, 1e9), default=60.0, metavar="SECONDS", help="time to measure in (default: 60)")
    add("--size", type=whole_numbers("WxH", "x", (1, 1)), metavar="WxH", help="film, pixels (default: the scene's)")
