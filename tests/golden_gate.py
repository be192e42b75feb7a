"""The gate of the golden pictures: what has to hold between a render and its stored twin of the same seed."""

import shutil
from pathlib import Path

import numpy as np

from raytrace import image
from raytrace.reporting.error import Limits, compare, violations

GOLDEN = Path(__file__).parent / "golden"
FAILURES = Path(__file__).parent / "failures"  # ignored by git
# Same seed, same address of every random number: all that may differ is rounding. On planted bugs SSIM 0.999 alone
# missed a light 3 % too bright and the mean alone a half-pixel shift; the four together missed none.
# Outliers: 9 pixels of 96 x 96, for rays whose last bit decides between two surfaces.
GATES = Limits(min_ssim=0.999, max_bias=1e-3, max_worst_tile=5e-3, max_outliers=1e-3)


def gate(actual, expected):
    """Violated gates, a line each; an empty list: `actual` passes for `expected`."""
    if np.shape(actual) != np.shape(expected):
        return [f"shape {np.shape(actual)} instead of {np.shape(expected)}"]
    return violations(compare(actual, expected), GATES)


def check_golden(name, rgb, *, update=False, golden=GOLDEN, failures=FAILURES):
    """Fail unless `rgb` passes the gate of ``<golden>/<name>.npz``; with `update`, write that file instead."""
    stored = Path(golden) / f"{name}.npz"
    folder = Path(failures) / name
    shutil.rmtree(folder, ignore_errors=True)  # of an earlier run
    if update:
        assert np.isfinite(rgb).all(), f"{name}: pixels that aren't finite are no golden"
        write(stored, rgb)
        return
    assert stored.exists(), f"there is no golden {stored}: look at the picture, then run pytest --update-golden"
    expected = image.load(stored).rgb
    if broken := gate(rgb, expected):
        write(folder / "actual.npz", rgb)
        write(folder / "expected.npz", expected)
        lines = [f"{name}: {len(broken)} gates are violated", *(f"- {line}" for line in broken)]
        if np.shape(rgb) == expected.shape:
            lines += ["", write_difference(folder / "difference.png", rgb, expected), "", numbers(rgb, expected)]
        (folder / "report.txt").write_text("\n".join(lines) + "\n")
        raise AssertionError("\n".join([*lines[: 1 + len(broken)], f"pictures and report.txt: {folder}"]))


def write(path, rgb):
    """Write the exact light as .npz and, for eyes, a .png beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path, rgb)
    image.save(path.with_suffix(".png"), rgb)


def write_difference(path, actual, expected):
    """Write |actual - expected|, its largest value white, and tell the factor; what isn't finite is white."""
    difference = np.abs(np.asarray(actual, np.float64) - expected)
    finite = np.isfinite(difference)
    largest = difference[finite].max(initial=0.0)
    image.save(path, np.where(finite, difference / (largest or 1.0), 1.0))
    return f"{path.name}: white is {largest:.6g}"


def numbers(actual, expected):
    """Every metric of the comparison, a line each."""
    fields = compare(actual, expected)._asdict()
    return "\n".join(f"{name} = {value}" for name, value in fields.items())
