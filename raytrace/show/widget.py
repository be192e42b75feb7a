"""``Viewer``: the widget that ``live`` gives. The browser's half is widget.js."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from anywidget import AnyWidget
from traitlets import Dict, Float, Int, List, TraitError, Unicode, validate

from raytrace.errors import RaytraceError
from raytrace.limits import MAX_SPP
from raytrace.records import Scene
from raytrace.rendering.rendering import render
from raytrace.show.background_renderer import BackgroundRenderer, EncodedImage
from raytrace.show.orbit import reach
from raytrace.show.path_drawing import path
from raytrace.show.prepared_scene import PreparedScene
from raytrace.show.scene_edits import SceneEdits, changed, refractive

STILL = 16  # samples a pixel of the picture that stands in where widgets do not run
CLOSEST, FARTHEST = 0.05, 20.0  # distances, of the scene's own


class Viewer(AnyWidget):
    """A scene in the hand; made by ``rt.show.live``.

    Attributes
    ----------
    azimuth, elevation : float, degrees
        How far the camera has been turned around what it looks at.
    distance : float
        Of the camera from there, in its first distance.
    power : float
        By which all fluxes are multiplied.
    ior : dict of str to float
        Index of refraction by name of a material; all others stay.
    spp : int
        Samples per pixel when the hand rests.

    Examples
    --------
    >>> import raytrace as rt
    >>> viewer = rt.show.live("scenes/cornell-box.json", spp=16)
    >>> viewer.azimuth = 30
    >>> viewer.scene.camera.position.round(2).tolist(), viewer.scene.settings.spp
    ([3.4, 1.0, 5.89], 16)
    """

    _esm = Path(__file__).with_name("widget.js")
    _css = Path(__file__).with_name("widget.css")
    azimuth = Float(0.0).tag(sync=True)
    elevation = Float(0.0).tag(sync=True)
    distance = Float(1.0, min=CLOSEST, max=FARTHEST).tag(sync=True)
    power = Float(1.0, min=0.0).tag(sync=True)
    ior = Dict().tag(sync=True)
    spp = Int(64, min=1, max=MAX_SPP).tag(sync=True)
    turn = Int().tag(sync=True)  # counts what the browser has asked for
    size = List(Int()).tag(sync=True)
    reach = List(Float()).tag(sync=True)  # least and largest elevation
    lights = Int().tag(sync=True)
    first_ior = Dict().tag(sync=True)
    about = Unicode().tag(sync=True)

    def __init__(self, prepared: PreparedScene, spp: int) -> None:
        scene = prepared.scene
        self._subject, self._own = prepared, refractive(scene)
        self._renderer = BackgroundRenderer(self._begin, self._frame, self._trouble)
        about = {"about": scene.about, "lights": len(scene.lights.flux), "reach": reach(scene.camera)}
        super().__init__(spp=spp, ior=self._own, first_ior=self._own, size=prepared.settings.size, **about)
        self.observe(lambda _: self._renderer.draw(), list(SceneEdits._fields))
        self.on_msg(self._hear)

    @validate("ior")
    def _check_ior(self, proposal: Any) -> dict[str, float]:
        """Keep what isn't given as it is in the scene."""
        for name, value in proposal["value"].items():
            if name not in self._own:
                raise TraitError(f"ior: no refractive material {name!r}; there are {', '.join(self._own) or 'none'}")
            if not 0 < value < float("inf"):
                raise TraitError(f"ior: {name}: expected a number above 0, got {value!r}")
        return self._own | proposal["value"]

    @property
    def scene(self) -> Scene:
        """The scene as it is shown, with size and samples: draw it with ``rt.render(viewer.scene)``."""
        return replace(self._now())  # which has a hash

    def _begin(self) -> Scene:
        """What the renderer is to draw."""
        self._drawn = self.turn
        return self._now()

    def _now(self) -> Scene:
        return changed(self._subject, SceneEdits(*(getattr(self, name) for name in SceneEdits._fields)))

    def _hear(self, _viewer: Any, message: dict[str, Any], _buffers: Any) -> None:
        """Do what the browser asks for."""
        if message["kind"] == "draw":
            self._renderer.draw()
        elif message["kind"] == "path":
            try:
                self.send({"kind": "path", "html": path(self._now(), tuple(message["pixel"]))._repr_html_()})
            except RaytraceError as error:
                self._trouble(error)
            except Exception as error:
                self._trouble(error)
                raise

    def _frame(self, frame: EncodedImage) -> None:
        about = {"type": frame.kind, "samples": frame.samples, "turn": self._drawn}
        self.send({"kind": "frame", **about}, [frame.data])

    def _trouble(self, error: Exception) -> None:
        self.send({"kind": "trouble", "text": str(error)})

    def __repr__(self) -> str:
        return f"<Viewer of {self._subject.name}: {self.size[0]}x{self.size[1]}, {self.spp} spp>"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """What a notebook shows, and keeps: the widget, and a picture for where widgets do not run."""
        data, about = super()._repr_mimebundle_(**options) or ({}, {})
        still = render(self._now(), spp=min(self.spp, STILL), progress=False)
        return data | {"image/png": still._repr_png_()}, about
