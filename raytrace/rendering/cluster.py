"""Parts of a picture drawn by the workers of a Dask cluster: the same bits as on one machine.

A part is a task. A task holds the columns and rows of its pixels, a range of samples, and the sums that the pixels have
so far where there are any; its result are the sums that they have then. The scene is the result of a task too, on which
all others depend: so it travels to each worker once, from whichever worker has it, and comes back if all of those die.
Dask draws a part again whose worker died.

How many pixels a part has is a compromise that ``tests/bench/cluster_model.py`` computes: the scheduler takes about a
millisecond a task, however many workers there are, and all wait for the last part of a slow one.
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
from raytrace.rendering.cluster_worker import Drawn, Order, Refusal, draw, hold
from raytrace.rendering.film_tiles import FilmTile
from raytrace.rendering.job import Job, Tiling, build
from raytrace.rendering.work_items import WorkItem

if TYPE_CHECKING:
    from distributed import Client, Future

PARTS = 64  # of a picture, for each thread of the cluster: more gain little, as tests/bench/cluster_model.py shows
TASK = 1e-3  # seconds that the scheduler takes for a task, so that n threads should take n of these for theirs
SHORT = 0.2  # seconds that a part should take at least: caller, scheduler and worker spend some 0.01 on it
RATE = 2e7  # samples a second that a thread draws of a simple scene; of others fewer, so that parts take longer
SLOW = 10  # times fewer, of a scene that may still be expected
AHEAD = 3  # tasks that the scheduler is given ahead, for each thread
PAUSED = 30.0  # seconds without a result after which paused workers are no longer waited for
MEMORY = "ran out of memory; give workers more (--memory-limit), or fewer threads each, or take a smaller scene"
SOON = 0.01  # seconds between two looks at whether the scene has come
LOOK = 1.0  # seconds between two looks at how many threads there are

Numbered = tuple[WorkItem, int]


_sent: "WeakKeyDictionary[Client, tuple[str, Future]]" = WeakKeyDictionary()  # the last scene of each client


def connect(address: str) -> "Client":
    """A client of the scheduler at an address; Dask's own configuration says how, and with which certificates.

    Raises
    ------
    OptionError
        Nobody answers, or Dask is missing.
    """
    try:
        from distributed import Client
        from distributed.comm import resolve_address
    except ImportError:
        raise OptionError("cluster: needs Dask: pip install distributed") from None
    try:
        resolve_address(address)  # a client that can't do that is not easily got rid of
        return Client(address, set_as_default=False, name="raytrace")
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise OptionError(f"cluster: {address}: no scheduler answers: {reason}") from None


def part_pixels(pixels: int, samples: int, threads: int) -> int:
    """How many pixels a part should have, of a picture of so many with so many samples each, for so many threads.

    >>> part_pixels(2**22, 256, 2), part_pixels(2**22, 256, 1000)
    (32768, 78125)
    """
    return max(pixels // (PARTS * threads), part_samples(threads) // samples)


def part_samples(threads: int) -> int:
    """How many samples a part should have at least, for so many threads.

    >>> part_samples(2), part_samples(1000)
    (4000000, 20000000)
    """
    return int(max(SHORT, TASK * threads) * RATE)


def _workers(client: "Client") -> list[dict[str, Any]]:
    """What the scheduler knows of all workers; without words, some versions tell of the first five alone."""
    try:
        known = client.scheduler_info(n_workers=-1)
    except TypeError:  # of an older version
        known = client.scheduler_info()
    if "workers" not in known:
        raise OSError("no scheduler is connected")
    return list(known["workers"].values())


class Cluster:
    """The workers of a scheduler, for one picture.

    Parameters
    ----------
    client : distributed.Client
    job : Job
    """

    def __init__(self, client: "Client", job: Job) -> None:
        if getattr(client, "asynchronous", False):
            raise OptionError("client: expected one that waits for its answers, got an asynchronous one")
        self._client, self._scene = client, job.scene
        self._order = Order(job.scene.sha256, job.settings, job.precision)
        self._name, self._tasks = f"raytrace-{os.urandom(8).hex()}", count()
        self._threads, self._looked, self._checked = 0, -np.inf, -np.inf
        self._refused: set[str] = set()
        self._rays, self._seconds = Counter[str](), dict[str, float]()

    def layout(self, layout: Tiling, pixels: int) -> Tiling:
        """A layout for a picture of so many pixels, in parts that suit as many threads as there are now."""
        threads = max(self._look(), 1)
        return layout._replace(at_least=pixels // (PARTS * threads), work=part_samples(threads))

    def expected(self, samples: int) -> float:
        """Seconds that so many samples may take; no scene of this folder takes longer."""
        return samples / (max(self._look(), 1) * RATE / SLOW)

    def rays(self) -> Counter[str]:
        """Rays traced so far, by kind."""
        return self._rays

    def seconds(self) -> dict[str, float]:
        """Seconds spent so far, by pass; summed over threads."""
        return dict(self._seconds)

    def draw(
        self,
        parts: Sequence[Numbered],
        lend: Callable[[WorkItem], FilmTile],
        take: Callable[[Numbered, NDArray[np.float64], float], None],
        over: Callable[[], bool],
        report: Callable[[int], None],
    ) -> bool:
        """Have parts drawn; whether all were.

        Parameters
        ----------
        parts : sequence of (Part, int)
            With their numbers.
        lend, take : callable
            Give a part's sheet; take the sums of its pixels, when it is drawn, with the seconds that took.
        over : callable
            Says that it is time to stop.
        report : callable
            Is given the number of parts that are done.

        Raises
        ------
        OptionError
            The scheduler has gone, no worker is left that may draw, or a part kills whatever worker draws it.
        """
        from distributed import CancelledError, KilledWorker

        waiting, flying, landed = deque(parts), dict["Future", Numbered](), SimpleQueue["Future"]()
        try:
            scene, done, landed_last = self._send_scene(over), 0, time.monotonic()
            while not over():
                while waiting and len(flying) < max(1, AHEAD * self._look()):
                    self._submit(scene, lend, waiting.popleft(), flying, landed)
                if not flying:
                    return True
                self._check_running(landed_last)
                for numbered, result in self._gather(flying, landed):
                    landed_last = time.monotonic()
                    if isinstance(result, Refusal):
                        self._refuse(result)
                        waiting.appendleft(numbered)
                    else:
                        self._count(result)
                        take(numbered, result.sums, sum(result.seconds.values()))
                        done += 1
                report(done)
            return False
        except (OSError, CancelledError) as error:
            flying.clear()  # nobody is there to be told
            raise OptionError("cluster: the scheduler has gone; a checkpoint has what came back") from error
        except KilledWorker as error:
            raise OptionError(f"cluster: {error}") from error
        except MemoryError as error:
            raise OptionError(f"cluster: a worker {MEMORY}") from error
        finally:
            if flying:
                with contextlib.suppress(OSError):
                    self._client.cancel(list(flying))

    def _look(self) -> int:
        """Threads of all workers that are not refused; the answer may be old by `LOOK`."""
        if time.monotonic() > self._looked + LOOK:
            known = self._client.nthreads()
            self._workers = known.keys() - self._refused
            self._threads = sum(known[worker] for worker in self._workers)
            self._looked = time.monotonic()
            if self._refused and not self._workers:
                raise OptionError(f"cluster: no worker is left that has raytrace {build()}")
        return self._threads

    def _check_running(self, since: float) -> None:
        """Raise where nothing came back since then, and all workers have paused."""
        if time.monotonic() < max(since + PAUSED, self._checked + LOOK):
            return
        self._checked = time.monotonic()
        workers = _workers(self._client)
        if workers and all(worker.get("status") == "paused" for worker in workers):
            raise OptionError(f"cluster: every worker has paused, as it {MEMORY}")

    def _send_scene(self, over: Callable[[], bool]) -> "Future":
        """The scene on the cluster, with a copy on every worker; sent but once."""
        sha256, future = _sent.get(self._client, ("", None))
        if sha256 != self._order.scene or future is None or future.status != "finished":
            import dask

            content = dumps(replace(self._scene, source=None), protocol=5)  # a path of this system means nothing there
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
                future = self._client.submit(hold, content, key=f"raytrace-scene-{self._order.scene}", pure=False)
            _sent[self._client] = self._order.scene, future
        began = time.monotonic()
        while future.status == "pending" and not over():  # there may be no worker yet
            self._check_running(began)
            time.sleep(SOON)
        if future.status == "cancelled":
            raise OSError("no scheduler is connected")
        if future.status == "finished":
            with contextlib.suppress(ValueError):  # no worker runs now; those that do later fetch it by themselves
                self._client.replicate([future])
        return future

    def _submit(
        self,
        scene: "Future",
        lend: Callable[[WorkItem], FilmTile],
        numbered: Numbered,
        flying: dict["Future", Numbered],
        landed: "SimpleQueue[Future]",
    ) -> None:
        part = numbered[0]
        sheet = lend(part)
        sums = sheet.sums.copy() if part.first else None
        work = scene, self._order, sheet.x, sheet.y, (part.first, part.last), sums
        only = list(self._workers) if self._refused else None
        future = self._client.submit(
            draw, build(), *work, key=(self._name, next(self._tasks)), workers=only, pure=False
        )
        flying[future] = numbered
        future.add_done_callback(landed.put)

    def _gather(
        self, flying: dict["Future", Numbered], landed: "SimpleQueue[Future]"
    ) -> Iterator[tuple[Numbered, Drawn | Refusal]]:
        """Parts that came back since, if any did within `POLL`."""
        futures = []
        with contextlib.suppress(Empty):
            futures.append(landed.get(timeout=POLL))
            while True:
                futures.append(landed.get_nowait())
        for future, result in zip(futures, self._client.gather(futures), strict=True):
            yield flying.pop(future), result

    def _count(self, drawn: Drawn) -> None:
        """Add up what a worker did."""
        self._rays.update(drawn.rays)
        for name, seconds in drawn.seconds.items():
            self._seconds[name] = self._seconds.get(name, 0.0) + seconds

    def _refuse(self, refusal: Refusal) -> None:
        """Give a worker nothing more."""
        if refusal.worker not in self._refused:
            self._refused.add(refusal.worker)
            text = f"cluster: worker {refusal.worker} is refused: it has raytrace {refusal.build}, not {build()}"
            logging.getLogger("raytrace").warning(text)
        self._looked = -np.inf
