"""The code that cluster workers run: ``draw`` renders a work item of any image.

A worker compiles a scene with the first work item of an image, and keeps the render threads of the last few images.
"""

import threading
from collections import Counter, OrderedDict
from functools import partial
from pickle import loads
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.jit import on_compile
from raytrace.records import Settings
from raytrace.rendering.film_tiles import FilmTile, blank, pieces
from raytrace.rendering.job import build
from raytrace.rendering.kernels import Traits, compile_ahead, traits_of
from raytrace.rendering.threads import RenderThreads
from raytrace.rendering.wavefront import BATCH
from raytrace.scene.plan import make_plan

KEPT = 4  # images whose render threads a worker keeps


class Order(NamedTuple):
    """What a worker needs to render an image, besides its scene."""

    scene: str  # its hash
    settings: Settings
    precision: str
    light: bool  # whether to keep the light layers


class Rendered(NamedTuple):
    """The result of a work item."""

    sums: NDArray[np.float64]  # (12, n) of the pixels, or (21, n) with light layers
    rays: Counter[str]  # traced for this item, by kind
    seconds: dict[str, float]  # spent on it, by pass


class Refusal(NamedTuple):
    """The answer of a worker that has another version of raytrace."""

    worker: str
    build: str


_threads: OrderedDict[Order, RenderThreads] = OrderedDict()
_lock = threading.Lock()


def share(scene: bytes) -> bytes:
    """Return the pickled scene: as the result of a task, workers copy it from each other."""
    return scene


def draw(caller: str, *work: Any) -> Rendered | Refusal:
    """Render a work item for a caller that has the same version of raytrace."""
    if caller != build():
        from distributed import get_worker

        return Refusal(str(get_worker().address), build())
    return _draw(*work)


def _draw(scene: bytes, order: Order, x: Any, y: Any, samples: tuple[int, int], sums: Any) -> Rendered:
    threads = _threads_of(scene, order)
    rays, seconds = threads.mine()
    tile = blank(np.array(x), np.array(y), order.light)  # copies: arrays from the network may be unaligned or read-only
    if sums is not None:
        tile.sums[:] = sums
    for piece in pieces(len(tile.x), BATCH // (samples[1] - samples[0])):  # as large as in a local render
        threads.draw(FilmTile(tile.x[piece], tile.y[piece], tile.film, piece.start), *samples)
    rays_after, seconds_after = threads.mine()
    spent = {name: after - seconds.get(name, 0.0) for name, after in seconds_after.items()}
    return Rendered(tile.sums, rays_after - rays, spent)


def _threads_of(scene: bytes, order: Order) -> RenderThreads:
    """Return the render threads of an image; the first thread that needs them makes them, and the others wait."""
    with _lock:
        if order not in _threads:
            _threads[order] = _make(scene, order)
            while len(_threads) > KEPT:
                _threads.popitem(last=False)
        _threads.move_to_end(order)
        return _threads[order]


def _make(content: bytes, order: Order) -> RenderThreads:
    alike = [threads for other, threads in _threads.items() if other.scene == order.scene]
    scene = alike[0].scene if alike else loads(content)
    plan = make_plan(scene)
    traits = traits_of(scene, plan, order.precision, order.settings, light=order.light)
    with on_compile(partial(_compile, traits)):
        threads = RenderThreads(scene, plan, order.precision, order.settings, order.light)
        threads.load_kernels()
    return threads


def _compile(traits: Traits) -> None:
    compile_ahead([traits], lambda _done, _total: None)
