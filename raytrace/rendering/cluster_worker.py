"""What the workers of a cluster run: ``draw``, for parts of whatever picture comes.

A worker builds a scene's tree when it meets its first part, and keeps it with the last few pictures.
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
from raytrace.rendering.film_tiles import FilmTile, blank
from raytrace.rendering.job import build
from raytrace.rendering.kernels import Picture, compile_ahead, picture_of
from raytrace.rendering.threads import RenderThreads
from raytrace.rendering.wavefront import BATCH
from raytrace.rendering.work_items import pieces
from raytrace.scene.plan import make_plan

CREWS = 4  # that a worker keeps


class Order(NamedTuple):
    """What a worker must know of a picture beside its scene."""

    scene: str  # its hash
    settings: Settings
    precision: str


class Drawn(NamedTuple):
    """What comes back."""

    sums: NDArray[np.float64]  # (12, n) of the pixels
    rays: Counter[str]  # traced for this part, by kind
    seconds: dict[str, float]  # spent on it, by pass


class Refusal(NamedTuple):
    """A worker's answer when it has another version."""

    worker: str
    build: str


_crews: OrderedDict[Order, RenderThreads] = OrderedDict()
_turn = threading.Lock()


def hold(scene: bytes) -> bytes:
    """The pickled scene as the result of a task, which workers hand to each other."""
    return scene


def draw(caller: str, *work: Any) -> Drawn | Refusal:
    """Draw a part, for a caller of the same version."""
    if caller != build():
        from distributed import get_worker

        return Refusal(str(get_worker().address), build())
    return _draw(*work)


def _draw(scene: bytes, order: Order, x: Any, y: Any, samples: tuple[int, int], sums: Any) -> Drawn:
    crew = _crew_of(scene, order)
    rays, seconds = crew.mine()
    sheet = blank(np.array(x), np.array(y))  # what came over the wire may be neither aligned nor writable
    if sums is not None:
        sheet.sums[:] = sums
    for piece in pieces(len(sheet.x), BATCH // (samples[1] - samples[0])):  # as large as threads have them elsewhere
        crew.draw(FilmTile(sheet.x[piece], sheet.y[piece], sheet.film, piece.start), *samples)
    rays_after, seconds_after = crew.mine()
    spent = {name: after - seconds.get(name, 0.0) for name, after in seconds_after.items()}
    return Drawn(sheet.sums, rays_after - rays, spent)


def _crew_of(scene: bytes, order: Order) -> RenderThreads:
    """The crew of a picture; made by the first thread that needs it, while the others wait."""
    with _turn:
        if order not in _crews:
            _crews[order] = _make(scene, order)
            while len(_crews) > CREWS:
                _crews.popitem(last=False)
        _crews.move_to_end(order)
        return _crews[order]


def _make(content: bytes, order: Order) -> RenderThreads:
    alike = [crew for other, crew in _crews.items() if other.scene == order.scene]
    scene = alike[0].scene if alike else loads(content)
    plan = make_plan(scene)
    needed = picture_of(scene, plan, order.precision, order.settings)
    with on_compile(partial(_compile, needed)):
        crew = RenderThreads(scene, plan, order.precision, order.settings)
        crew.load_kernels()
    return crew


def _compile(picture: Picture) -> None:
    compile_ahead([picture], lambda _done, _total: None)
