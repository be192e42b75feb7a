"""The viewer of a web page, in Python: its values, and the images that it sends. ``widget.js`` is its part in the page.

It is what ``widget.py`` is to a notebook, and needs no package for widgets.
"""

import math
import threading
from typing import Any, NamedTuple

from raytrace.errors import OptionError, RaytraceError
from raytrace.limits import MAX_SPP
from raytrace.records import Scene
from raytrace.rendering.rendering import within
from raytrace.show.background_renderer import BackgroundRenderer, EncodedImage
from raytrace.show.hidden_backs import HiddenBacks
from raytrace.show.light_handles import check_positions, light_handles, positions_of
from raytrace.show.orbit import elevation_limits
from raytrace.show.prepared_scene import PreparedScene
from raytrace.show.scene_edits import MAX_SCALE, SceneEdits, edited, indices_of_refraction, number_of_lights


class Message(NamedTuple):
    """A message for the page."""

    number: int  # in order, from 1
    content: dict[str, Any]  # as JSON types; its "kind" says what it is about
    data: bytes  # of an image, else empty


class PageModel:
    """The values of a viewer, and messages for its pages.

    Parameters
    ----------
    prepared : PreparedScene
    spp : int
        Samples per pixel of the final image.

    Attributes
    ----------
    state : dict
        All values that the page reads, by name, as JSON types.

    Examples
    --------
    >>> import raytrace as rt
    >>> from raytrace.show.prepared_scene import prepare_scene
    >>> model = PageModel(prepare_scene(rt.load("scenes/cornell-box-glass.json"), (8, 6)), 4)
    >>> model.state["ior"], model.state["size"]
    ({'pane': 0.5}, [8, 6])
    """

    def __init__(self, prepared: PreparedScene, spp: int) -> None:
        scene = prepared.scene
        self._prepared, self._own = prepared, indices_of_refraction(scene)
        self._backs = HiddenBacks(scene, prepared.compiled.bvh)
        self._lights = positions_of(scene.lights).tolist()
        self.state: dict[str, Any] = SceneEdits(ior=self._own, spp=spp, light_positions=self._lights)._asdict() | {
            "turn": 0,  # number of changes that a page has sent
            "size": list(prepared.settings.size),
            "elevation_limits": list(elevation_limits(scene.camera)),
            "lights": number_of_lights(scene),
            "first_ior": self._own,
            "first_light_positions": self._lights,
            "about": scene.about,
        }
        self._newest: dict[str, Message] = {}  # by kind: older ones are not worth sending
        self._count, self._rendered_turn = 0, 0
        self._changed = threading.Condition()
        self._renderer = BackgroundRenderer(self._begin, self._send_frame, self._send_error, prepared.settings.size)

    def scene(self) -> Scene:
        """Return the scene as displayed."""
        return edited(self._prepared, SceneEdits(*(self.state[name] for name in SceneEdits._fields)), self._backs)

    def change(self, values: dict[str, Any]) -> None:
        """Set values, and render the scene anew.

        Raises
        ------
        OptionError
            A name that is unknown, or a value of the wrong type or range; then nothing is set.
        """
        self.state |= {name: self._checked(name, value) for name, value in values.items()}
        self._renderer.request()

    def receive(self, message: dict[str, Any]) -> None:
        """Handle a message of the page: a request for an image, or for the path of a pixel."""
        if message.get("kind") == "render":  # a new page, which older messages do not concern
            with self._changed:
                self._newest.clear()
            self._renderer.request()
        elif message.get("kind") == "path":
            try:
                from raytrace.show.path_drawing import path

                self._send({"kind": "path", "html": path(self.scene(), _pixel(message))._repr_html_()})
            except RaytraceError as error:
                self._send_error(error)

    def message_after(self, number: int, seconds: float) -> Message | None:
        """Wait for a message newer than one with a number, and return it; None after some seconds."""

        def newer() -> list[Message]:
            return sorted(message for message in self._newest.values() if message.number > number)

        with self._changed:
            self._changed.wait_for(newer, seconds)
            return next(iter(newer()), None)

    def _checked(self, name: str, value: Any) -> Any:
        if name == "ior" and isinstance(value, dict):
            for material, index in value.items():
                if material not in self._own or not _number(index) > 0:
                    raise OptionError(f"ior: {material}: expected an index above 0 of one of {', '.join(self._own)}")
            return self._own | {material: float(index) for material, index in value.items()}
        if name == "light_positions":
            return check_positions(value, self._lights)
        if name == "spp":
            return within("spp", value, 1, MAX_SPP)
        if name == "scale":
            return within("scale", value, 1, MAX_SCALE)
        if name == "turn":
            return within("turn", value, 0, 2**53)
        first = SceneEdits._field_defaults.get(name)
        if isinstance(first, bool) and isinstance(value, bool):
            return value
        least = -math.inf if name in ("azimuth", "elevation") else 0.0 if name == "power" else 1e-6
        if not isinstance(first, float) or not _number(value) >= least:
            raise OptionError(f"{name}: got {value!r}")
        return float(value)

    def _begin(self) -> Scene:
        """The scene to render, at the start of a render."""
        self._rendered_turn = self.state["turn"]
        scene = self.scene()
        self._handles = light_handles(scene)
        return scene

    def _send_frame(self, frame: EncodedImage) -> None:
        about = {"type": frame.kind, "samples": frame.samples, "turn": self._rendered_turn, "handles": self._handles}
        self._send({"kind": "frame", **about}, frame.data)

    def _send_error(self, error: Exception) -> None:
        self._send({"kind": "error", "text": str(error)})

    def _send(self, content: dict[str, Any], data: bytes = b"") -> None:
        with self._changed:
            self._count += 1
            self._newest[content["kind"]] = Message(self._count, content, data)
            self._changed.notify_all()


def _number(value: Any) -> float:
    """Return a finite number; NaN for anything else."""
    return float(value) if type(value) in (int, float) and math.isfinite(value) else math.nan


def _pixel(message: dict[str, Any]) -> tuple[int, int]:
    """Return the pixel of a message; ``path`` checks its numbers."""
    pixel = message.get("pixel")
    if not isinstance(pixel, list) or len(pixel) != 2:
        raise OptionError(f"pixel: expected x and y, got {pixel!r}")
    return pixel[0], pixel[1]
