"""``Render``: an image, its error, its layers, and its provenance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.image import files
from raytrace.limits import LAYERS, LIGHT_LAYERS
from raytrace.passes.camera import make_view, parallel_origins, pinhole_directions
from raytrace.records import Hits, Scene, View, Window

if TYPE_CHECKING:
    from raytrace.rendering.checkpoint import Checkpoint

ASK = 'not kept; ask for it before the render: rt.render(scene, integrator="path", aov=["emission", ...])'
ROWS = 64  # of pixels: the layers are computed in bands of so many


class Layers(Mapping[str, NDArray[Any]]):
    """AOVs by name; all are computed when the first one is needed, along the rays through the pixels' centres.

    Those of the samples' light are there only if they were asked for before the render. "uv" is computed by itself,
    because files may have to be read for it.

    Attributes
    ----------
    computed : dict of str to array
        The layers used so far; files contain these.
    """

    def __init__(
        self, samples: NDArray[np.int32], trace: Callable[[str], dict[str, NDArray[Any]]], light: bool = False
    ) -> None:
        self._names = LAYERS + LIGHT_LAYERS if light else LAYERS
        self._known: dict[str, NDArray[Any]] = {"samples": samples}
        self._trace = trace
        self.computed: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._names:
            raise KeyError(f"{name!r}: {ASK if name in LIGHT_LAYERS else 'expected one of ' + ', '.join(self._names)}")
        if name not in self._known:
            self._known |= self._trace(name)
        self.computed[name] = self._known[name]
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def put_light(self, light: NDArray[np.float32]) -> None:
        """Set the layers of the samples' light, (h, w, 3 layers, 3)."""
        self._known |= {name: np.ascontiguousarray(light[:, :, k]) for k, name in enumerate(LIGHT_LAYERS)}


@dataclass(frozen=True, eq=False, repr=False)
class Render:
    """A rendered image.

    Attributes
    ----------
    rgb : (h, w, 3) float32 array
        Linear radiance, row 0 at the top; 0 where no sample was taken.
    stderr : (h, w) float32 array
        Estimated standard error of the pixel's luminance, for the sampler that was used. With eight or more samples,
        the true value is within 3.18 standard errors in 95 % of cases (Student's t, 3 degrees of freedom). NaN with
        fewer than two samples.
    var : (h, w, 3) float32 array
        Estimated variance of each channel's mean, of linear radiance squared, by the same model as ``stderr``: its root
        is the channel's standard error. NaN with fewer than two samples.
    aov : Mapping
        Layers "depth", "normal", "albedo", "prim_id", "position", "samples", "uv", computed on first use. Also
        "emission", "direct" and "indirect", if one of them was asked for in the call of ``render``, with the
        integrator "path".
    stats : dict
        Rays by kind (including those that only fill a tile's last packet), seconds by pass (summed over threads),
        compile seconds, samples, "estimated_error" (RMSE in sRGB clipped to 0..1), "estimated_error_linear" (RMSE of
        luminance), "target_reached" (None without a target error).
    provenance : dict
        Version, scene hash, seed, settings, seconds: what is written into files. "spp" is the requested number
        of samples per pixel, "samples" the number that every pixel has.
    complete : bool
        False after Ctrl-C or a time limit. The image then has the samples of the last complete round over all pixels.
    interrupted : bool
        True after Ctrl-C, or the stop button of a notebook.
    checkpoint : Checkpoint or None
        The file of finished work items; ``save`` deletes it if the image is complete.

    Examples
    --------
    >>> import numpy as np
    >>> import raytrace as rt
    >>> image = rt.render("scenes/cornell-box.json", spp=1, size=(16, 16))
    >>> np.asarray(image).shape
    (16, 16, 3)
    """

    rgb: NDArray[np.float32]
    stderr: NDArray[np.float32]
    var: NDArray[np.float32]
    aov: Layers
    stats: dict[str, Any]
    provenance: dict[str, Any]
    complete: bool
    interrupted: bool
    checkpoint: Checkpoint | None = None

    def save(self, path: str | Path, exposure: files.Exposure = 0.0) -> Path:
        """Write the image as PNG (sRGB), EXR (linear, with layers) or NPZ (arrays), depending on the file extension.

        Parameters
        ----------
        path : str or Path
        exposure : float, stops, or "auto"
            PNG only: radiance is multiplied by 2**exposure. "auto": the brightest 5 % of the lit pixels begin one stop
            below white. The number is in the provenance of the file.

        Returns
        -------
        Path

        Raises
        ------
        FileError
            The file extension is unknown, or the file can't be written.

        Examples
        --------
        >>> import raytrace as rt
        >>> rt.render("scenes/cornell-box.json", spp=1, size=(16, 16)).save("box.png").name  # doctest: +SKIP
        'box.png'
        """
        layers = self.aov.computed
        written = files.save(
            path,
            self.rgb,
            stderr=self.stderr,
            var=self.var,
            aov=layers,
            provenance=self.provenance,
            exposure=exposure,
        )
        if self.checkpoint and self.complete:
            self.checkpoint.remove()
        return written

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.rgb, dtype=dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        return files.png_bytes(self.rgb, self.provenance, 0.0)

    def __repr__(self) -> str:
        height, width = self.stderr.shape
        state = "" if self.complete else ", incomplete"
        error = self.stats["estimated_error"]
        known = "error unknown" if np.isnan(error) else f"error {error:.2g}"
        return f"<Render {width}x{height}, {_taken(self)} spp, {self.provenance['seconds']:.2f} s, {known}{state}>"


def _taken(image: Render) -> str:
    """Samples per pixel: those taken, and those requested if they differ."""
    asked, taken = image.provenance["spp"], image.stats["samples"] / image.stderr.size
    if image.stats["target_reached"] is not None:
        return f"{taken:.3g} of at most {asked}"
    return f"{asked}" if taken == asked else f"{taken:.10g} of {asked}"


def state_of(image: Render) -> str:
    """Say why a render ended early, and how many samples its image has; "" if it is complete."""
    if image.complete:
        return ""
    why = "interrupted" if image.interrupted else "time limit reached"
    if not image.provenance["samples"]:
        return f"{why} before the first round of samples was complete"
    average = " on average" if image.stats["target_reached"] is not None else ""
    return f"{why} at {_taken(image)} samples per pixel{average}"


def trace_layers(
    scene: Scene, bvh: BVH, size: tuple[int, int], window: Window, name: str = ""
) -> dict[str, NDArray[Any]]:
    """Compute the layers of a window of the film: "uv" alone, or all others."""
    make = _uv_of if name == "uv" else _layers_of
    view = make_view(scene.camera, size, np.dtype(np.float64))
    bands = []
    for top in range(window.y, window.y + window.height, ROWS):
        y, x = np.mgrid[top : min(top + ROWS, window.y + window.height), window.x : window.x + window.width] + 0.5
        bands.append(make(scene, bvh, bvh.closest_hit(*centre_rays(scene, view, x.ravel(), y.ravel()))))
    layers = {name: np.concatenate([band[name] for band in bands]) for name in bands[0]}
    return {name: layer.reshape(window.height, window.width, *layer.shape[1:]) for name, layer in layers.items()}


def _uv_of(scene: Scene, _bvh: BVH, hits: Hits) -> dict[str, NDArray[Any]]:
    """Texture coordinates at hits; NaN for misses, and for meshes without uv."""
    from raytrace.rendering.uv_layer import uv_of

    return {"uv": uv_of(scene, hits)}


def centre_rays(scene: Scene, view: View, x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return origins and directions through points of the film, of a pinhole where the camera has a lens."""
    if scene.camera.height is None:
        return scene.camera.position, pinhole_directions(view, x, y)
    o = parallel_origins(view, x, y)
    return o, np.broadcast_to(view.forward, o.shape)


def _layers_of(scene: Scene, bvh: BVH, hits: Hits) -> dict[str, NDArray[Any]]:
    """Layers of rays; a miss has depth inf, prim_id -1, position NaN, normal and albedo 0."""
    missed = (hits.prim_id < 0)[:, None]
    prim_id = np.maximum(hits.prim_id, 0)
    surface = bvh.surface(hits)
    normal = surface.ng
    if scene.mesh.normals is not None:
        u, v = hits.u[:, None], hits.v[:, None]
        n0, n1, n2 = (scene.mesh.normals[prim_id, k] for k in range(3))
        normal = (1 - u - v) * n0 + u * n1 + v * n2
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    if scene.textures is None:
        albedo = scene.materials.albedo[scene.mesh.material_id[prim_id]]
    else:
        from raytrace.rendering.albedo_layer import albedo_at

        albedo = albedo_at(scene, prim_id, np.where(missed[:, 0], 0, hits.u), np.where(missed[:, 0], 0, hits.v))
    return {
        "depth": hits.t.astype(np.float32),
        "normal": np.where(missed, 0, normal).astype(np.float32),
        "albedo": np.where(missed, 0, albedo).astype(np.float32),
        "prim_id": hits.prim_id,
        "position": surface.p.astype(np.float32),
    }
