"""What the notebooks share: checks of exercises, pictures side by side, and meshes."""

import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import raytrace as rt

MESHES = Path(__file__).parents[2] / "scenes" / "meshes"
RESULTS: dict[str, str] = {}  # what the checks found: exercise -> "solved", or what is missing

plt.rcParams |= {
    "figure.dpi": 110,
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
        RESULTS[exercise] = f"not yet: {type(problem).__name__}: {problem}"
    else:
        RESULTS[exercise] = "solved"
    print(f"{'✓' if RESULTS[exercise] == 'solved' else '✗'} exercise {exercise}: {RESULTS[exercise]}")


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
