"""``Golden``: what the fixture gives."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from raytrace.golden import store
from raytrace.golden.gates import Gates, Verdict, judge
from raytrace.golden.locations import GoldenLocation
from raytrace.golden.noise import mean_of
from raytrace.golden.page import Failure, page
from raytrace.golden.pixels import Encoding, to_light
from raytrace.image.files import save
from raytrace.output_folder import check_folder, write

LEFT = ".html", ".actual.npz"  # what a failure leaves
__tracebackhide__ = True  # pytest shows the line of the test, and not how it was found wanting


class Golden:
    """Compares pictures with golden ones; the fixture ``golden`` of the pytest plugin.

    Parameters
    ----------
    place : GoldenLocation
    given : mapping of str to float or None
        Gates that differ from the defaults.
    update : bool
        Write goldens instead of reading them.

    Attributes
    ----------
    written : list of Path
        Goldens written so far.
    """

    def __init__(self, place: GoldenLocation, given: Mapping[str, float | None], update: bool) -> None:
        self.place, self.given, self.update = place, dict(given), update
        self.written: list[Path] = []

    def check(
        self, image: Any, name: str, *, encoding: Encoding = None, pictures: int = 64, **gates: float | None
    ) -> Verdict:
        """Fail unless a picture passes the gates of its golden; with ``--update-goldens``, write that instead.

        Parameters
        ----------
        image : Render, path, array, or function
            The picture; or, if it is noisy, a function of a seed that draws it: ``draw(0)`` is checked, and the golden
            is the mean of ``draw(1)`` .. ``draw(pictures)``, with the variance of each pixel.
        name : str
            Of the golden, without an ending; unique in its folder.
        encoding : {"linear", "srgb"}, optional
            What the numbers of an array mean. Default: floats are linear light, uint8 are sRGB codes.
        pictures : int
            That make up the golden of a noisy picture.
        **gates : float or None
            Limits for this check: min_ssim, max_bias, max_worst_tile, max_outliers, alpha, max_rejected; None: no
            limit. Default: what pytest's configuration says, or else ``Gates``. For noisy pictures SSIM and outliers
            are checked only if asked for here, and bias and worst tile are what noise does not explain.

        Returns
        -------
        Verdict
            The numbers.

        Raises
        ------
        AssertionError
            A gate failed, or there is no golden; one line with the numbers and the path of a page.
        ValueError, FileError
            Something isn't a picture, or can't be read or written; a gate isn't known.

        Examples
        --------
        >>> import raytrace as rt
        >>> def test_box(golden):
        ...     golden.check(rt.render("scenes/cornell-box.json", spp=4, size=(96, 96)), "cornell-box")
        """
        path = self.place.golden(name)
        for kind in LEFT:
            self.place.left(name, kind).unlink(missing_ok=True)  # of an earlier run
        if unknown := gates.keys() - set(Gates._fields):
            raise ValueError(f"unknown gates {', '.join(sorted(unknown))}; the gates are {', '.join(Gates._fields)}")
        actual = to_light(image(0) if callable(image) else image, encoding)
        if self.update:
            store.write(path, self._approved(image, actual, pictures, encoding))
            self.written.append(path)
        golden = store.read(path) if path.exists() else None
        if golden is None:
            why = f"there is no {self.place.short(path)}: look at the picture, then write it: {self.place.command}"
            self._fail(Failure(name, self.place, why, actual, None, None))
        if actual.shape != golden.rgb.shape:
            (height, width, _), (tall, wide, _) = actual.shape, golden.rgb.shape
            why = f"the size is {width}x{height} instead of {wide}x{tall}"
            self._fail(Failure(name, self.place, why, actual, golden, None))
        verdict = judge(actual, golden, self._gates(golden, gates))
        if not verdict:
            self._fail(Failure(name, self.place, "; ".join(verdict.broken), actual, golden, verdict))
        return verdict

    def _gates(self, golden: store.GoldenImage, called: Mapping[str, float | None]) -> Gates:
        """Defaults, then pytest's configuration, then the call."""
        configured = Gates()._replace(**self.given)
        if golden.stderr is not None:
            configured = configured._replace(min_ssim=None, max_outliers=None)  # they see noise as well
        return configured._replace(**called)

    def _approved(
        self, image: Any, actual: NDArray[np.float64], pictures: int, encoding: Encoding
    ) -> store.GoldenImage:
        """What is written as a golden."""
        if not callable(image):
            golden = store.GoldenImage(actual, None, 1)
        elif pictures < 2:
            raise ValueError(f"pictures: expected 2 or more for a variance, got {pictures}")
        else:
            rgb, stderr = mean_of(image, pictures, lambda picture: to_light(picture, encoding))
            golden = store.GoldenImage(rgb, stderr, pictures)
        if not (np.abs(golden.rgb) <= np.finfo(np.float32).max).all():
            raise AssertionError("golden: can't save an image with pixels that aren't finite in float32")
        return golden

    def _fail(self, failure: Failure) -> NoReturn:
        """Leave a page and the picture, and say where, in one line."""
        html, npz = (self.place.left(failure.name, kind) for kind in LEFT)
        check_folder(html.parent)
        save(npz, _within_float32(failure.actual))
        write(html.parent, {html.name: page(failure).encode()})
        numbers = "" if failure.verdict is None else f" ({failure.verdict})"
        raise AssertionError(f"golden {failure.name!r}: {failure.why}{numbers}; see {self.place.short(html)}")


def _within_float32(light: NDArray[np.float64]) -> NDArray[np.float32]:
    """Numbers as a file has them; those that are too large are inf."""
    with np.errstate(over="ignore"):
        return light.astype(np.float32)
