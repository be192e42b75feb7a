"""``Golden``: the object that the fixture returns; it compares images with golden images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from raytrace.golden import store
from raytrace.golden.gates import Gates, Verdict, judge
from raytrace.golden.locations import GoldenLocation
from raytrace.golden.noise import mean_of
from raytrace.golden.page import Failure, failure_page
from raytrace.golden.pixels import Encoding, to_light
from raytrace.image.files import save
from raytrace.output_folder import check_folder, write

FAILURE_FILES = ".html", ".actual.npz"  # files written for a failure
__tracebackhide__ = True  # pytest shows the line of the test, not of this file


class Golden:
    """Compares images with golden images; the fixture ``golden`` of the pytest plugin.

    Parameters
    ----------
    location : GoldenLocation
    configured : mapping of str to float or None
        Gates from pytest's configuration.
    update : bool
        Write golden images instead of reading them.

    Attributes
    ----------
    written : list of Path
        Golden images written so far.
    failed : list of Path
        Pages of failures written so far.
    """

    def __init__(self, location: GoldenLocation, configured: Mapping[str, float | None], update: bool) -> None:
        self.location, self.configured, self.update = location, dict(configured), update
        self.written: list[Path] = []
        self.failed: list[Path] = []

    def check(
        self, image: Any, name: str, *, encoding: Encoding = None, pictures: int = 64, **gates: float | None
    ) -> Verdict:
        """Compare an image with its golden image, and fail if a gate fails; or write it, with ``--update-goldens``.

        Parameters
        ----------
        image : Render, path, array, or function
            The image; or, for a noisy image, a function that renders it with a seed. ``image(0)`` is checked. The
            golden image is the mean of ``image(1)`` .. ``image(pictures)``, with the variance of each pixel.
        name : str
            Name of the golden image without an extension; unique in its folder.
        encoding : {"linear", "srgb"}, optional
            Meaning of the values of an array. Default: floats are linear light, uint8 are sRGB codes.
        pictures : int
            Number of images in the mean, for a noisy image.
        **gates : float or None
            Limits for this check: min_ssim, max_bias, max_worst_tile, max_outliers, alpha, max_rejected, max_flip;
            None: no limit. Default: pytest's configuration, then ``Gates``. For noisy images, SSIM, outliers and FLIP
            are checked only if they are given here, and bias and worst tile are what remains after the noise is
            subtracted.

        Returns
        -------
        Verdict
            The result with all numbers.

        Raises
        ------
        AssertionError
            A gate failed, or there is no golden image; one line with the numbers and the path of a page.
        ValueError, FileError
            The argument is not an image, a file can't be read or written, or a gate is unknown.
        OptionError
            ``max_flip`` is given, and flip-evaluator isn't installed.

        Examples
        --------
        >>> import raytrace as rt
        >>> def test_box(golden):
        ...     golden.check(rt.render("scenes/cornell-box.json", spp=4, size=(96, 96)), "cornell-box")
        """
        path = self.location.golden(name)
        for kind in FAILURE_FILES:
            self.location.failure_file(name, kind).unlink(missing_ok=True)  # files of an earlier run
        if unknown := gates.keys() - set(Gates._fields):
            raise ValueError(f"unknown gates {', '.join(sorted(unknown))}; the gates are {', '.join(Gates._fields)}")
        actual = to_light(image(0) if callable(image) else image, encoding)
        if self.update:
            store.write(path, self._approved(image, actual, pictures, encoding))
            self.written.append(path)
        golden = store.read(path) if path.exists() else None
        if golden is None:
            why = f"there is no {self.location.short(path)}: look at the image, then write it: {self.location.command}"
            self._fail(Failure(name, self.location, why, actual, None, None))
        if actual.shape != golden.rgb.shape:
            (height, width, _), (tall, wide, _) = actual.shape, golden.rgb.shape
            why = f"the size is {width}x{height} instead of {wide}x{tall}"
            self._fail(Failure(name, self.location, why, actual, golden, None))
        verdict = judge(actual, golden, self._gates(golden, gates))
        if not verdict:
            self._fail(Failure(name, self.location, "; ".join(verdict.broken), actual, golden, verdict))
        return verdict

    def _gates(self, golden: store.GoldenImage, called: Mapping[str, float | None]) -> Gates:
        """Gates of a check: the defaults, replaced by pytest's configuration, then by the call."""
        configured = Gates()._replace(**self.configured)
        if golden.stderr is not None:
            configured = configured._replace(min_ssim=None, max_outliers=None, max_flip=None)  # noise affects them
        return configured._replace(**called)

    def _approved(
        self, image: Any, actual: NDArray[np.float64], pictures: int, encoding: Encoding
    ) -> store.GoldenImage:
        """The golden image to write."""
        if not callable(image):
            golden = store.GoldenImage(actual, None, 1)
        elif pictures < 2:
            raise ValueError(f"pictures: expected 2 or more for a variance, got {pictures}")
        else:
            rgb, stderr = mean_of(image, pictures, lambda one: to_light(one, encoding))
            golden = store.GoldenImage(rgb, stderr, pictures)
        if not (np.abs(golden.rgb) <= np.finfo(np.float32).max).all():
            raise AssertionError("golden: can't save an image with pixels that are not finite in float32")
        return golden

    def _fail(self, failure: Failure) -> NoReturn:
        """Write a page and the image, and raise an error with the path of the page."""
        html, npz = (self.location.failure_file(failure.name, kind) for kind in FAILURE_FILES)
        check_folder(html.parent)
        save(npz, _within_float32(failure.actual))
        write(html.parent, {html.name: failure_page(failure).encode()})
        self.failed.append(html)
        numbers = "" if failure.verdict is None else f" ({failure.verdict})"
        raise AssertionError(f"golden {failure.name!r}: {failure.why}{numbers}; see {self.location.short(html)}")


def _within_float32(light: NDArray[np.float64]) -> NDArray[np.float32]:
    """Round to float32, as in files; values out of range become inf."""
    with np.errstate(over="ignore"):
        return light.astype(np.float32)
