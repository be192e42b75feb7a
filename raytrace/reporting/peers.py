"""Other renderers as rows of a report: Mitsuba 3, and the textbook of this package."""

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError, SceneError
from raytrace.exporting.export import export_files
from raytrace.limits import MAX_SEED
from raytrace.parallel import thread_count
from raytrace.records import Scene
from raytrace.reporting.configurations import Configuration, ConfiguredScene
from raytrace.reporting.reference import SEED_STEP

SAMPLERS = "independent", "multijitter"  # of Mitsuba: the one of its exported scenes, and a stratified one
VARIANT = "llvm_ad_rgb"  # compiled for the CPU
PASS = 1 << 25  # most samples of Mitsuba at a time: it keeps all paths of a pass in memory


class PeerImage(NamedTuple):
    """An image of another renderer, with the fields of ``Render`` that a sweep reads."""

    rgb: NDArray[np.float32]
    stats: dict[str, Any]
    interrupted: bool = False


def peers_of(scene: Scene) -> tuple[list[Configuration], tuple[tuple[str, str], ...]]:
    """Return the configurations of the other renderers that can render a scene, and why others cannot.

    Returns
    -------
    configurations : list of Configuration
    missing : tuple of (str, str)
        Name of a renderer, and the reason in one line.
    """
    found: list[Configuration] = []
    missing = []
    for name, configurations, reason in (
        ("Mitsuba", [Configuration(s, "float32", renderer="Mitsuba") for s in SAMPLERS], why_no_mitsuba(scene)),
        ("textbook", [Configuration("stratified", "float64", renderer="textbook")], why_no_textbook(scene)),
    ):
        if reason:
            missing.append((name, reason))
        else:
            found += configurations
    return found, tuple(missing)


def why_no_mitsuba(scene: Scene) -> str:
    """Why Mitsuba cannot render a scene here, in one line; "" if it can."""
    if find_spec("mitsuba") is None:
        return "not installed; pip install mitsuba"
    if "DRJIT_LIBLLVM_PATH" not in os.environ:  # some versions of LLVM abort the process
        return "set DRJIT_LIBLLVM_PATH to the path of a libLLVM; version 19 works"
    try:
        export_files(scene, "mitsuba")
    except SceneError as error:
        return " ".join(str(error).split())
    return ""


def why_no_textbook(scene: Scene) -> str:
    """Why the textbook cannot render a scene, in one line; "" if it can."""
    from raytrace import textbook

    try:
        textbook.render(scene, 1, (1, 1))
    except OptionError as error:
        return " ".join(str(error).split())
    return ""


def make_configured(scene: Scene, configuration: Configuration, size: tuple[int, int]) -> Any:
    """Return the object that renders a scene in a configuration, by the renderer that it names."""
    made: Callable[[Scene, Configuration, tuple[int, int]], Any] = {
        "raytrace": ConfiguredScene,
        "Mitsuba": MitsubaScene,
        "textbook": TextbookScene,
    }[configuration.renderer]
    return made(scene, configuration, size)


class MitsubaScene:
    """A scene that Mitsuba renders, on as many threads as this package."""

    table_bytes = 0

    def __init__(self, scene: Scene, configuration: Configuration, size: tuple[int, int]) -> None:
        self.configuration, self.size, self.warm = configuration, size, set[int]()
        mi = import_module("mitsuba")
        mi.set_variant(VARIANT)
        mi.set_log_level(mi.LogLevel.Error)
        import_module("drjit").set_thread_count(thread_count(None))
        exported = export_files(replace(scene, settings=scene.settings._replace(size=size)), "mitsuba", name="scene")
        with tempfile.TemporaryDirectory() as name:
            for path, data in exported.files.items():
                if path == exported.scene:
                    data = data.replace(b'"independent"', f'"{configuration.sampler}"'.encode())
                (Path(name) / path).parent.mkdir(parents=True, exist_ok=True)
                (Path(name) / path).write_bytes(data)
            self.scene = mi.load_file(str(Path(name) / exported.scene))

    def passes_of(self, spp: int) -> tuple[int, int]:
        """Return the number of passes, a power of 4, and the samples per pixel of each: a square for multijitter."""
        passes = 1
        while spp * self.size[0] * self.size[1] > PASS * passes and spp >= 4 * passes:
            passes *= 4
        each = max(round(spp / passes), 1)
        return passes, each if self.configuration.sampler == "independent" else max(round(each**0.5), 1) ** 2

    def render(self, step: float, seed: int) -> PeerImage:
        """Render one image; the first of each number of samples is rendered twice, and its compilation not timed."""
        passes, spp = self.passes_of(int(step))
        began, compiling = time.perf_counter(), 0.0
        if spp not in self.warm:
            self._pass(spp, seed)
            self.warm.add(spp)
            compiling = time.perf_counter() - began
        rgb = self._pass(spp, seed)
        for k in range(1, passes):
            rgb = rgb + self._pass(spp, (seed + k * SEED_STEP) % (MAX_SEED + 1))
        return _image(rgb / np.float32(passes), passes * spp, compiling)

    def _pass(self, spp: int, seed: int) -> NDArray[np.float32]:
        return np.array(import_module("mitsuba").render(self.scene, spp=spp, seed=seed), np.float32)[..., :3]


class TextbookScene:
    """A scene that ``raytrace.textbook`` renders: NumPy on one thread."""

    table_bytes = 0

    def __init__(self, scene: Scene, configuration: Configuration, size: tuple[int, int]) -> None:
        self.scene, self.configuration, self.size = scene, configuration, size

    def render(self, step: float, seed: int) -> PeerImage:
        """Render one image."""
        from raytrace import textbook  # only where it is asked for

        rgb = textbook.render(self.scene, int(step), self.size, seed)
        return _image(rgb, int(step), 0.0)


def _image(rgb: NDArray[Any], spp: int, compiling: float) -> PeerImage:
    samples = spp * rgb.shape[0] * rgb.shape[1]
    return PeerImage(np.asarray(rgb, np.float32), {"compile_seconds": compiling, "rays": {}, "samples": samples})
