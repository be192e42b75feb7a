"""The command ``view``: the interactive viewer, in a web browser."""

import contextlib
import os
import sys
import webbrowser
from argparse import Namespace
from collections.abc import Callable
from typing import TYPE_CHECKING

import raytrace
from raytrace.cli import streams
from raytrace.cli.failures import DONE
from raytrace.cli.terminal import Reporter, at_terminal, signals_interrupt
from raytrace.errors import printable, without_scene_warnings

if TYPE_CHECKING:
    from raytrace.records import Scene

SIDE = 512  # default pixels of the longer side
SPP = 64


def view(args: Namespace, load: Callable[[Namespace], "Scene"]) -> int:
    """Serve the viewer until Ctrl-C; return the exit code.

    Raises
    ------
    RaytraceError
        What is wrong with the scene or an option.
    """
    with signals_interrupt(), without_scene_warnings():  # printed here, with their position in the file
        scene = load(args)
        from raytrace.limits import MAX_SPP
        from raytrace.rendering.rendering import within
        from raytrace.show.page_model import PageModel
        from raytrace.show.page_server import PageServer
        from raytrace.show.prepared_scene import prepare_scene

        for warning in scene.warnings:
            streams.say(f"warning: {warning}")
        prepared = prepare_scene(scene, args.size or _smaller(scene), args.integrator)
        model = PageModel(prepared, within("spp", args.spp or SPP, 1, MAX_SPP))
        with Reporter(streams.say, bar=at_terminal(), lines=not at_terminal()) as reporter:
            image = raytrace.render(model.scene(), spp=1, progress=reporter)  # compiles here, where a bar shows it
        if image.interrupted:
            raise KeyboardInterrupt
        with (
            PageServer(model, f"raytrace: {printable(args.scene.name)}") as server,
            contextlib.suppress(KeyboardInterrupt),
        ):
            streams.out(server.address)
            streams.flush()
            if not args.no_browser and not _open(server.address):
                streams.say(
                    "no browser was found here: open the address in one (from another computer, through "
                    f"ssh -L {server.server_port}:127.0.0.1:{server.server_port} THIS_HOST)"
                )
            streams.say("Ctrl-C ends the viewer")
            server.serve_forever()
    return DONE


def _smaller(scene: "Scene") -> tuple[int, int]:
    """Return the size of the scene's image, made smaller where a side has more than SIDE pixels."""
    width, height = scene.settings.size
    scale = min(SIDE / max(width, height), 1.0)
    return max(round(scale * width), 1), max(round(scale * height), 1)


def _open(address: str) -> bool:
    """Open an address in a browser with a window; whether there is one."""
    windows = sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")))
    try:
        return bool(windows) and webbrowser.open(address)  # without a window, Python would open one in this terminal
    except webbrowser.Error:
        return False
