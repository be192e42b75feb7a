"""Renders work items on the workers of a Dask cluster; the image is bit-identical to that of one machine.

Each work item is a task. It has the columns and rows of the pixels, a range of samples, and the sums of the pixels so
far, if any; its result is the new sums. The scene is also the result of a task, and all other tasks depend on it. So
each worker copies it once, from any worker that has it, and Dask recreates it if all of those die. Dask also repeats a
work item whose worker died.

The size of a work item is a compromise, computed by ``tests/bench/cluster_model.py``: the scheduler takes about one
millisecond per task for any number of workers, and all workers wait for the last item of a slow one.
"""

import contextlib
import logging
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from pickle import dumps
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.parallel import POLL
from raytrace.rendering.cluster_worker import Order, Refusal, Rendered, draw, share
from raytrace.rendering.film_tiles import FilmTile, WorkItem
from raytrace.rendering.job import Job, Tiling, build

if TYPE_CHECKING:
    from distributed import Client, Future

ITEMS = 64  # work items per thread of the cluster; more bring little, as tests/bench/cluster_model.py shows
TASK = 1e-3  # seconds of the scheduler per task: with n threads, a task should take at least n times as long
SHORT = 0.2  # seconds that an item should take at least: caller, scheduler and worker need about 0.01 for it
RATE = 2e7  # samples per second and thread of a simple scene; others are slower, so their items take longer
SLOW = 10  # times slower is the slowest scene that is expected
AHEAD = 3  # tasks per thread that the scheduler has at any time
PAUSED = 30.0  # seconds without a result, after which the render stops waiting for paused workers
MEMORY = "ran out of memory; give workers more (--memory-limit), fewer threads each, or a smaller scene"
SOON = 0.01  # seconds between two checks whether the scene has arrived
RECHECK = 1.0  # seconds between two checks of the number of threads

Numbered = tuple[WorkItem, int]

_sent: "WeakKeyDictionary[Client, tuple[str, Future]]" = WeakKeyDictionary()  # the last scene that each client sent


def connect(address: str) -> "Client":
    """Connect to the scheduler at an address; TLS and other settings come from Dask's own configuration.

    Raises
    ------
    OptionError
        No scheduler answers, or Dask is missing.
    """
    try:
        from distributed import Client
        from distributed.comm import resolve_address
    except ImportError:
        raise OptionError("cluster: needs Dask: pip install distributed") from None
    try:
        resolve_address(address)  # a client that failed to connect is hard to close
        return Client(address, set_as_default=False, name="raytrace")
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise OptionError(f"cluster: {address}: no scheduler answers: {reason}") from None


def item_pixels(pixels: int, samples: int, threads: int) -> int:
    """Pixels that a work item should have, for an image of ``pixels`` with ``samples`` each, on so many threads.

    >>> item_pixels(2**22, 256, 2), item_pixels(2**22, 256, 1000)
    (32768, 78125)
    """
    return max(pixels // (ITEMS * threads), item_samples(threads) // samples)


def item_samples(threads: int) -> int:
    """Samples that a work item should have at least, on so many threads.

    >>> item_samples(2), item_samples(1000)
    (4000000, 20000000)
    """
    return int(max(SHORT, TASK * threads) * RATE)


def _workers(client: "Client") -> list[dict[str, Any]]:
    """Return what the scheduler knows about all workers; by default, some versions list only the first five."""
    try:
        info = client.scheduler_info(n_workers=-1)
    except TypeError:  # an older version
        info = client.scheduler_info()
    if "workers" not in info:
        raise OSError("no scheduler is connected")
    return list(info["workers"].values())


class Cluster:
    """The workers of a scheduler, for one image.

    Parameters
    ----------
    client : distributed.Client
    job : Job
    """

    def __init__(self, client: "Client", job: Job) -> None:
        if getattr(client, "asynchronous", False):
            raise OptionError("client: expected a synchronous client, got an asynchronous one")
        self._client, self._scene = client, job.scene
        self._order = Order(job.scene.sha256, job.settings, job.precision, job.light)
        self._name, self._tasks = f"raytrace-{os.urandom(8).hex()}", count()
        self._threads, self._counted, self._checked = 0, -np.inf, -np.inf
        self._refused: set[str] = set()
        self._rays, self._seconds = Counter[str](), dict[str, float]()

    def tiling(self, tiling: Tiling, pixels: int) -> Tiling:
        """Return the tiling of an image of so many pixels, with work items that suit the present number of threads."""
        threads = max(self._count_threads(), 1)
        return tiling._replace(at_least=pixels // (ITEMS * threads), work=item_samples(threads))

    def expected(self, samples: int) -> float:
        """Estimate the longest time for so many samples, in seconds; no shipped scene takes longer."""
        return samples / (max(self._count_threads(), 1) * RATE / SLOW)

    def rays(self) -> Counter[str]:
        """Rays traced so far, by kind."""
        return self._rays

    def seconds(self) -> dict[str, float]:
        """Seconds spent so far, by pass; summed over threads."""
        return dict(self._seconds)

    def draw(
        self,
        items: Sequence[Numbered],
        get_tile: Callable[[WorkItem], FilmTile],
        receive: Callable[[Numbered, NDArray[np.float64], float], None],
        over: Callable[[], bool],
        report: Callable[[int], None],
    ) -> bool:
        """Render work items on the workers; whether all were rendered.

        Parameters
        ----------
        items : sequence of (WorkItem, int)
            With their numbers.
        get_tile : callable
            Returns the tile of a work item.
        receive : callable
            Called with each rendered item, the sums of its pixels, and the seconds that it took.
        over : callable
            Whether to stop.
        report : callable
            Called with the number of items that are done.

        Raises
        ------
        OptionError
            The scheduler is gone, no worker can be used any more, or a work item kills every worker that renders it.
        """
        from distributed import CancelledError, KilledWorker

        waiting, running, finished = deque(items), dict["Future", Numbered](), SimpleQueue["Future"]()
        try:
            scene, done, last = self._send_scene(over), 0, time.monotonic()
            while not over():
                while waiting and len(running) < max(1, AHEAD * self._count_threads()):
                    self._submit(scene, get_tile, waiting.popleft(), running, finished)
                if not running:
                    return True
                self._check_paused(last)
                for numbered, result in self._gather(running, finished):
                    last = time.monotonic()
                    if isinstance(result, Refusal):
                        self._refuse(result)
                        waiting.appendleft(numbered)
                    else:
                        self._count(result)
                        receive(numbered, result.sums, sum(result.seconds.values()))
                        done += 1
                report(done)
            return False
        except (OSError, CancelledError) as error:
            running.clear()  # there is no scheduler to cancel them
            raise OptionError(
                "cluster: the connection to the scheduler is lost; a checkpoint has the finished work items"
            ) from error
        except KilledWorker as error:
            raise OptionError(f"cluster: {error}") from error
        except MemoryError as error:
            raise OptionError(f"cluster: a worker {MEMORY}") from error
        finally:
            if running:
                with contextlib.suppress(OSError):
                    self._client.cancel(list(running))

    def _count_threads(self) -> int:
        """Number of threads of all workers that are not refused, at most `RECHECK` seconds old."""
        if time.monotonic() > self._counted + RECHECK:
            threads = self._client.nthreads()
            self._workers = threads.keys() - self._refused
            self._threads = sum(threads[worker] for worker in self._workers)
            self._counted = time.monotonic()
            if self._refused and not self._workers:
                raise OptionError(f"cluster: no worker has raytrace {build()}")
        return self._threads

    def _check_paused(self, since: float) -> None:
        """Raise if there was no result since then, and all workers have paused."""
        if time.monotonic() < max(since + PAUSED, self._checked + RECHECK):
            return
        self._checked = time.monotonic()
        workers = _workers(self._client)
        if workers and all(worker.get("status") == "paused" for worker in workers):
            raise OptionError(f"cluster: every worker has paused, as it {MEMORY}")

    def _send_scene(self, over: Callable[[], bool]) -> "Future":
        """Return the scene on the cluster, with a copy on every worker; it is sent once."""
        sha256, future = _sent.get(self._client, ("", None))
        if sha256 != self._order.scene or future is None or future.status != "finished":
            import dask

            content = dumps(replace(self._scene, source=None), protocol=5)  # a path has no meaning on another machine
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
                future = self._client.submit(share, content, key=f"raytrace-scene-{self._order.scene}", pure=False)
            _sent[self._client] = self._order.scene, future
        began = time.monotonic()
        while future.status == "pending" and not over():  # there may be no worker yet
            self._check_paused(began)
            time.sleep(SOON)
        if future.status == "cancelled":
            raise OSError("no scheduler is connected")
        if future.status == "finished":
            with contextlib.suppress(ValueError):  # no worker is running; later ones copy it when they need it
                self._client.replicate([future])
        return future

    def _submit(
        self,
        scene: "Future",
        get_tile: Callable[[WorkItem], FilmTile],
        numbered: Numbered,
        running: dict["Future", Numbered],
        finished: "SimpleQueue[Future]",
    ) -> None:
        item = numbered[0]
        tile = get_tile(item)
        sums = tile.sums.copy() if item.first else None
        work = scene, self._order, tile.x, tile.y, (item.first, item.last), sums
        only = list(self._workers) if self._refused else None
        future = self._client.submit(
            draw, build(), *work, key=(self._name, next(self._tasks)), workers=only, pure=False
        )
        running[future] = numbered
        future.add_done_callback(finished.put)

    def _gather(
        self, running: dict["Future", Numbered], finished: "SimpleQueue[Future]"
    ) -> Iterator[tuple[Numbered, Rendered | Refusal]]:
        """Yield the items that have finished, after waiting up to `POLL` seconds for one."""
        futures = []
        with contextlib.suppress(Empty):
            futures.append(finished.get(timeout=POLL))
            while True:
                futures.append(finished.get_nowait())
        for future, result in zip(futures, self._client.gather(futures), strict=True):
            yield running.pop(future), result

    def _count(self, result: Rendered) -> None:
        """Add the rays and seconds of a worker to the totals."""
        self._rays.update(result.rays)
        for name, seconds in result.seconds.items():
            self._seconds[name] = self._seconds.get(name, 0.0) + seconds

    def _refuse(self, refusal: Refusal) -> None:
        """Send no more work to a worker."""
        if refusal.worker not in self._refused:
            self._refused.add(refusal.worker)
            text = f"cluster: worker {refusal.worker} is not used: it has raytrace {refusal.build}, not {build()}"
            logging.getLogger("raytrace").warning(text)
        self._counted = -np.inf
