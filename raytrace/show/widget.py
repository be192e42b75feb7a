"""``Viewer``: the widget that ``live`` returns; widget.js is its part in the browser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from anywidget import AnyWidget
from traitlets import Bool, Dict, Float, Int, List, TraitError, Unicode, validate

from raytrace.errors import RaytraceError
from raytrace.limits import MAX_SPP
from raytrace.records import Scene
from raytrace.rendering.rendering import render
from raytrace.show.background_renderer import BackgroundRenderer, EncodedImage
from raytrace.show.hidden_backs import HiddenBacks
from raytrace.show.light_handles import check_positions, light_handles, positions_of
from raytrace.show.orbit import elevation_limits
from raytrace.show.path_drawing import path
from raytrace.show.prepared_scene import PreparedScene
from raytrace.show.scene_edits import MAX_SCALE, SceneEdits, edited, indices_of_refraction, number_of_lights

STILL_SPP = 16  # samples per pixel of the static image for front ends without widgets
CLOSEST, FARTHEST = 0.05, 20.0  # limits of ``distance``


class Viewer(AnyWidget):
    """An interactive viewer of a scene; made by ``rt.show.live``.

    Attributes
    ----------
    azimuth, elevation : float, degrees
        Rotation of the camera around the point that it looks at.
    distance : float
        Factor for the distance of the camera from that point.
    power : float
        Factor for all lights: fluxes, intensities, irradiances, and the radiance of lamps and of the environment.
    ior : dict of str to float
        Index of refraction by name of a refractive or dielectric material; materials that are not named keep theirs.
    spp : int
        Samples per pixel of the final image.
    light_positions : list of [x, y, z], world units
        Positions of the point lights, then of the spot lights, in the order of the scene.
    hide_backs : bool
        Whether one-sided walls that the camera sees from behind are hidden from it. ``scene`` does not contain this.
    scale : int
        Pixels of the image at rest for each pixel of the image that moves, along a side. The browser sets it, so that
        the image at rest has a pixel for each of the screen.

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
    light_positions = List(List(Float())).tag(sync=True)
    hide_backs = Bool(False).tag(sync=True)
    scale = Int(1, min=1, max=MAX_SCALE).tag(sync=True)
    turn = Int().tag(sync=True)  # number of changes that the browser has sent
    size = List(Int()).tag(sync=True)
    elevation_limits = List(Float()).tag(sync=True)  # smallest and largest elevation
    lights = Int().tag(sync=True)
    first_ior = Dict().tag(sync=True)
    first_light_positions = List(List(Float())).tag(sync=True)
    about = Unicode().tag(sync=True)

    def __init__(self, prepared: PreparedScene, spp: int) -> None:
        scene = prepared.scene
        self._prepared, self._own = prepared, indices_of_refraction(scene)
        self._backs = HiddenBacks(scene, prepared.compiled.bvh)
        self._renderer = BackgroundRenderer(self._begin, self._send_frame, self._send_error, prepared.settings.size)
        self._lights = positions_of(scene.lights).tolist()
        about = {
            "light_positions": self._lights,
            "first_light_positions": self._lights,
            "about": scene.about,
            "lights": number_of_lights(scene),
            "elevation_limits": elevation_limits(scene.camera),
        }
        super().__init__(spp=spp, ior=self._own, first_ior=self._own, size=prepared.settings.size, **about)
        self.observe(lambda _: self._renderer.request(), list(SceneEdits._fields))
        self.on_msg(self._receive)

    @validate("ior")
    def _check_ior(self, proposal: Any) -> dict[str, float]:
        """Check the indices; materials that are not given keep the index of the scene."""
        for name, value in proposal["value"].items():
            if name not in self._own:
                raise TraitError(
                    f"ior: no material {name!r} with an index of refraction; there are {', '.join(self._own) or 'none'}"
                )
            if not 0 < value < float("inf"):
                raise TraitError(f"ior: {name}: expected a number above 0, got {value!r}")
        return self._own | proposal["value"]

    @validate("light_positions")
    def _check_lights(self, proposal: Any) -> list[list[float]]:
        """Check that each light has a position."""
        try:
            return check_positions(proposal["value"], self._lights)
        except RaytraceError as error:
            raise TraitError(str(error)) from None

    @property
    def scene(self) -> Scene:
        """The scene as displayed, with size and samples: ``rt.render(viewer.scene)`` renders it."""
        return replace(self._now())  # the copy computes its hash

    def _begin(self) -> Scene:
        """The scene to render, at the start of a render."""
        self._rendered_turn = self.turn
        scene = self._now()
        self._handles = light_handles(scene)
        return scene

    def _now(self) -> Scene:
        return edited(self._prepared, SceneEdits(*(getattr(self, name) for name in SceneEdits._fields)), self._backs)

    def _receive(self, _viewer: Any, message: dict[str, Any], _buffers: Any) -> None:
        """Handle a message from the browser."""
        if message["kind"] == "render":
            self._renderer.request()
        elif message["kind"] == "path":
            try:
                self.send({"kind": "path", "html": path(self._now(), tuple(message["pixel"]))._repr_html_()})
            except RaytraceError as error:
                self._send_error(error)
            except Exception as error:
                self._send_error(error)
                raise

    def _send_frame(self, frame: EncodedImage) -> None:
        about = {"type": frame.kind, "samples": frame.samples, "turn": self._rendered_turn, "handles": self._handles}
        self.send({"kind": "frame", **about}, [frame.data])

    def _send_error(self, error: Exception) -> None:
        self.send({"kind": "error", "text": str(error)})

    def __repr__(self) -> str:
        return f"<Viewer of {self._prepared.name}: {self.size[0]}x{self.size[1]}, {self.spp} spp>"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Output for a notebook: the widget, and a static image for front ends without widgets."""
        data, about = super()._repr_mimebundle_(**options) or ({}, {})
        still = render(self._now(), spp=min(self.spp, STILL_SPP), progress=False)
        return data | {"image/png": still._repr_png_()}, about
