"""What the notebooks share: checks of exercises, pictures side by side, and meshes."""

import io
import json
import linecache
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import raytrace as rt

MESHES = Path(__file__).parents[2] / "scenes" / "meshes"
RESULTS: dict[str, str] = {}  # what the checks found: exercise -> "solved", or what is missing

PI_WORDS = {
    np.pi: "π times too large; is there a division by π missing?",
    1 / np.pi: "too small by a factor of π; is there a division by π too many?",
    2 * np.pi: "2π times too large; is there a division by 2π missing?",
    4 * np.pi: "4π times too large; is there a division by 4π missing?",
    2.0: "twice too large",
    0.5: "half of what it should be",
    -1.0: "right, but for its sign",
}

np.set_printoptions(legacy="1.25")  # 0.5, not np.float64(0.5)
plt.rcParams |= {
    "figure.dpi": 110,
    "figure.max_open_warning": 0,
    "figure.constrained_layout.use": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "image.interpolation": "nearest",
}


@contextmanager
def check(exercise: str) -> Iterator[None]:
    """Print in one line whether an exercise is solved. An exception inside does not stop the notebook."""
    try:
        yield
    except NotImplementedError:
        RESULTS[exercise] = "yours to do"
    except AssertionError as problem:
        RESULTS[exercise] = f"not yet: {problem}"
    except Exception as problem:  # noqa: BLE001 - a student's code may raise anything; the line shows it
        RESULTS[exercise] = f"not yet: {type(problem).__name__}: {problem}{_place(problem)}"
    else:
        RESULTS[exercise] = "solved"
    print(f"{'✓' if RESULTS[exercise] == 'solved' else '✗'} exercise {exercise}: {RESULTS[exercise]}")


def _place(problem: Exception) -> str:
    """Return where in the notebook's cells an exception was raised: the line, its number, and the function."""
    frames = [frame for frame in traceback.extract_tb(problem.__traceback__) if not Path(frame.filename).is_file()]
    if not frames:
        return ""
    last = frames[-1]
    line = (last.line or linecache.getline(last.filename, last.lineno or 0)).strip()
    code = f": {line}" if line else ""
    if last.name == "<module>":  # no function of the student is under way: its answer cannot be used
        return (
            f" (in line {last.lineno} of the check{code}). Is what your function returns of the right type and shape?"
        )
    return f" (in line {last.lineno} of the cell, in {last.name}{code})"


def factor_hint(yours: Any, expected: Any) -> str:
    """Return a sentence if answers are off by a factor with a name, such as π; else nothing."""
    a, b = (np.asarray(getattr(x, "rgb", x), float).ravel() for x in (yours, expected))
    if a.shape != b.shape:
        return ""
    some = (np.abs(b) > 1e-3 * np.abs(b).max()) & (np.abs(a) > 1e-12 * np.abs(b).max())
    if some.sum() < 0.5 * (b != 0).sum() or not some.any():
        return ""
    ratio = a[some] / b[some]
    for factor, words in PI_WORDS.items():
        if np.mean(np.isclose(ratio, factor, rtol=0.02)) > 0.8:
            return f"; yours is {words}"
    return ""


def beside(yours: Any, expected: Any, edges: float = 0.05) -> None:
    """Show the student's image beside the library's, and raise if more pixels than those along edges differ."""
    theirs, found = np.asarray(expected.rgb, float), np.asarray(yours, float)
    assert found.shape == theirs.shape, f"the shape of the image is {theirs.shape}, not {found.shape}"
    finite = np.nan_to_num(found)
    row({"yours": screen(finite), "the library's": expected, "|difference|": screen(np.abs(finite - theirs))})
    broken = int((~np.isfinite(found)).any(axis=2).sum())
    assert broken == 0, f"{broken} pixels are NaN or infinite"
    outliers = rt.compare(found.astype(np.float32), expected).outliers
    assert outliers < edges, (
        f"{outliers:.1%} of the pixels differ; along edges alone it would be 3 %{factor_hint(found, theirs)}"
    )


def row(pictures: Mapping[str, Any], height: float = 2.6, **options: Any) -> None:
    """Show renders and arrays side by side, under their names; options are those of ``imshow``, for arrays."""
    figure, axes = plt.subplots(1, len(pictures), figsize=(0, 0), squeeze=False)
    width = 0.0
    for axis, (name, picture) in zip(axes[0], pictures.items(), strict=True):
        render = isinstance(picture, rt.Render)
        pixels = plt.imread(io.BytesIO(picture._repr_png_())) if render else np.asarray(picture)
        axis.imshow(pixels, **({} if render else options))
        axis.set_title(name, fontsize=10)
        axis.set_axis_off()
        width += height * pixels.shape[1] / pixels.shape[0]
    figure.set_size_inches(width + 0.1, height + 0.3)
    plt.show()


def screen(radiance: np.ndarray) -> np.ndarray:
    """Return linear radiance as screen values: clipped to 0..1, with the curve of sRGB."""
    x = np.clip(np.asarray(radiance, float), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def mesh(name: str, **placement: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (v, 3) and faces (m, 3) of a shipped mesh, placed like an object of a scene."""
    thing = {"mesh": MESHES / name, "material": "any", **placement}
    camera = {"position": [0, 0, 1], "look_at": [0, 0, 0], "fov": 45}
    found = rt.load({"camera": camera, "materials": {"any": {"type": "refractive", "ior": 1}}, "objects": [thing]}).mesh
    return found.vertices, found.faces


def described(name: str) -> dict[str, Any]:
    """Return the content of a shipped scene as a dict, ready to change and to render from any folder."""
    content = json.loads((MESHES.parent / f"{name}.json").read_text("utf-8"))
    for thing in content["objects"]:
        thing["mesh"] = MESHES.parent / thing["mesh"]
    return content
