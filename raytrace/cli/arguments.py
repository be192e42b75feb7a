"""Options of the command line, and parsers of their values; an error says what was expected and what was given."""

from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable
from pathlib import Path

from raytrace.cli.changes import set_option
from raytrace.cli.exposure import exposure
from raytrace.cli.parser import suggestion
from raytrace.limits import LAYERS, LIGHT_LAYERS, MAX_SPP


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


def whole_numbers(form: str, separator: str, lows: tuple[int, ...], example: str) -> Callable[[str], tuple[int, ...]]:
    """Return a parser for whole numbers with a separator between them, each with a lower bound.

    >>> whole_numbers("WxH", "x", (1, 1), "640x480")("64x48")
    (64, 48)
    """

    def parse(text: str) -> tuple[int, ...]:
        try:
            values = tuple(int(part) for part in text.lower().split(separator))
        except ValueError:
            values = ()
        if len(values) != len(lows):
            raise ArgumentTypeError(f"expected {form} in whole numbers, such as {example}, got '{text}'")
        if any(value < low for value, low in zip(values, lows, strict=True)):
            bounds = separator.join(str(low) for low in lows)
            raise ArgumentTypeError(f"expected {form} of at least {bounds}, such as {example}, got '{text}'")
        return values

    return parse


SIZE = whole_numbers("WxH", "x", (1, 1), "640x480")


class one_of:
    """A parser for one of several words, used as a function; its error suggests the closest one.

    Attributes
    ----------
    words : tuple of str
        What it accepts; shells complete these.
    """

    def __init__(self, *words: str) -> None:
        self.words = words

    def __call__(self, text: str) -> str:
        """Parse a word."""
        if text not in self.words:
            raise ArgumentTypeError(f"expected {', '.join(self.words)}, got '{text}'{suggestion(text, self.words)}")
        return text


LAYER = one_of(*LAYERS, *LIGHT_LAYERS)


def layers(text: str) -> tuple[str, ...]:
    """Parse names of layers, separated by commas."""
    return tuple(map(LAYER, text.split(",")))


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


def scenes_options(parser: ArgumentParser) -> None:
    """Declare several scene files and the options for loading them."""
    parser.add_argument("scenes", type=Path, nargs="+", metavar="scene", help="scene files (JSON), or mesh files")
    _load_options(parser)
    set_option(parser)


def check_options(parser: ArgumentParser) -> None:
    """Declare the options of ``check``."""
    scenes_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object: all problems, each with its place")


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
    scenes_options(parser)
    _image_options(parser)


def demo_options(parser: ArgumentParser) -> None:
    """Declare the options of ``demo``: those of ``render``, without a scene."""
    _memory_option(parser)
    set_option(parser)
    _image_options(parser)


def _image_options(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("-o", "--output", metavar="FILE", help=".png, .exr or .npz (default: ./<scene>.png); or a folder, as images/")
    add("--format", type=one_of("png", "exr", "npz"), metavar="F", help="png, exr or npz, where -o does not say it")
    _job_options(parser)
    text = "render on the Dask cluster at this address, such as tcp://host:8786"
    add("--cluster", metavar="ADDRESS", help=text)
    text = "resume from <output>.checkpoint if it exists; otherwise create it"
    add("--resume", action="store_true", help=text)
    text = "of a .png: multiply radiance by 2^STOPS; auto: so that the image is shown well"
    add("--exposure", type=exposure, default=0.0, metavar="STOPS", help=text)
    add("--quiet", action="store_true", help="no progress and no messages, only errors")
    add("--json", action="store_true", help="print one JSON object: path, seconds, statistics")


def _job_options(parser: ArgumentParser) -> None:
    """Declare what decides an image and its cost."""
    add = parser.add_argument
    add("--spp", type=whole_number(1, MAX_SPP), metavar="N", help="samples per pixel (default: the scene's)")
    add("--size", type=SIZE, metavar="WxH", help="image size in pixels (default: the scene's)")
    window = whole_numbers("X,Y,W,H", ",", (0, 0, 1, 1), "0,0,64,48")
    add("--crop", type=window, metavar="X,Y,W,H", help="render only W x H pixels, from column X and row Y")
    _integrator_option(parser)
    add("--seed", type=whole_number(0, 2**32 - 1), metavar="N", help="random seed (default: the scene's)")
    add("--precision", type=one_of("auto", "float32", "float64"), metavar="P", help="auto, float32 or float64")
    samplers = one_of("sobol", "stratified", "independent")
    add("--sampler", type=samplers, metavar="NAME", help="sobol, stratified or independent")
    add("--threads", type=whole_number(1, 4096), metavar="N", help="number of threads (default: one per core)")
    text = "stop after this time and save the image so far"
    add("--time-limit", type=real_number(1e-3, 1e9), metavar="SECONDS", help=text)
    text = "adaptive sampling to this RMSE (sRGB, 0..1), with at most --spp samples"
    add("--target-error", type=real_number(1e-6, 0.999), metavar="E", help=text)
    text = (
        f"layers to save in an .exr or .npz: {', '.join(LAYERS)}; with integrator path also {', '.join(LIGHT_LAYERS)}"
    )
    add("--aov", type=layers, default=(), metavar="A,B", help=text)


def explain_options(parser: ArgumentParser) -> None:
    """Declare the options of ``explain``: those of ``render`` that decide an image and its cost."""
    scenes_options(parser)
    _job_options(parser)


def _integrator_option(parser: ArgumentParser) -> None:
    text = "direct: light straight from the lights; path: all the light (default: the scene's)"
    parser.add_argument("--integrator", choices=("direct", "path"), help=text)


def view_options(parser: ArgumentParser) -> None:
    """Declare the options of ``view``."""
    scene_options(parser)
    add = parser.add_argument
    add("--size", type=SIZE, metavar="WxH", help="image size in pixels (default: the scene's, at most 512 a side)")
    add(
        "--spp", type=whole_number(1, MAX_SPP), metavar="N", help="samples per pixel of the image at rest (default: 64)"
    )
    _integrator_option(parser)
    add("--no-browser", action="store_true", help="print the address of the page, but open no browser")


def warmup_options(parser: ArgumentParser) -> None:
    """Declare the options of ``warmup``."""
    text = "scene files (JSON): compile only what these need (default: what all scenes without path tracing need)"
    parser.add_argument("scenes", type=Path, nargs="*", metavar="scene", help=text)
    text = "path: compile the kernels of path tracing too"
    parser.add_argument("--integrator", choices=("direct", "path"), default="direct", help=text)
    _load_options(parser)


def report_options(parser: ArgumentParser) -> None:
    """Declare the options of ``report``."""
    add = parser.add_argument
    about = "scene files (JSON) to measure speed and error of; several get a page each, and one page over all"
    add("scenes", type=Path, nargs="*", metavar="scene", help=about)
    _load_options(parser)
    set_option(parser)
    add("--hard-cases", action="store_true", help="instead of a scene, test rays that break ray tracers")
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the report")
    add("--reference", type=Path, metavar="FILE", help="reference image, .exr or .npz (default: rendered, and kept)")
    text = "measuring time per scene (default: 60)"
    add("--budget", type=real_number(1, 1e9), default=60.0, metavar="SECONDS", help=text)
    add("--peers", action="store_true", help="also measure Mitsuba 3 if it is installed, and the textbook")
    add("--size", type=SIZE, metavar="WxH", help="image size in pixels (default: the scene's)")


def completion_options(parser: ArgumentParser) -> None:
    """Declare the options of ``completion``."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="bash, zsh or fish")


def export_options(parser: ArgumentParser) -> None:
    """Declare the options of ``export``."""
    scene_options(parser)
    add = parser.add_argument
    add("--to", type=one_of("mitsuba", "pbrt"), required=True, metavar="NAME", help="mitsuba (3) or pbrt (v4)")
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the scene, its meshes and images")
    text = "replace what the other renderer cannot express by what is closest, with a warning for each"
    add("--approximate", action="store_true", help=text)
