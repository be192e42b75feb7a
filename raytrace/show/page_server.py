"""Serves the viewer as a web page, to browsers of this computer only."""

import json
import secrets
from functools import partial
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from raytrace.errors import OptionError
from raytrace.show.page_model import PageModel

HOST = "127.0.0.1"
PATIENCE = 20.0  # seconds after which a page that waits for a message asks again
MOST = 65536  # bytes of a request
TYPES = {".js": "text/javascript", ".css": "text/css"}
FILES = "widget.js", "widget.css", "page.js"
PAGE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<link rel="stylesheet" href="widget.css">
<style>
:root {{ color-scheme: light dark; --jp-ui-font-color2: color-mix(in srgb, CanvasText 70%, Canvas) }}
body {{ margin: 1rem; font: 14px/1.4 system-ui, sans-serif }}
table {{ border-spacing: 0.8em 0.1em }}
</style>
<h1 style="font-size: 1.2rem">{title}</h1>
<main></main>
<p role="status"></p>
<script type="module" src="page.js"></script>
"""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src data: blob:; connect-src 'self'"
)
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": POLICY,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer(ThreadingHTTPServer):
    """A server of one page, at a free port of this computer and a path that only its user knows.

    Parameters
    ----------
    model : PageModel
    title : str
        Name of the scene.

    Attributes
    ----------
    address : str
        Of the page.

    Notes
    -----
    Other users of this computer can reach the port, but do not know the path. Pages of the web know neither, and a name
    of theirs that leads to this computer is refused, because it is not the host that the request must name.
    """

    daemon_threads = True
    block_on_close = False  # a page that waits for a message may wait for long

    def __init__(self, model: PageModel, title: str) -> None:
        self.root = f"/{secrets.token_urlsafe(16)}/"
        super().__init__((HOST, 0), partial(_Handler, model, title))
        self.address = f"http://{HOST}:{self.server_port}{self.root}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that close their connections."""


class _Handler(BaseHTTPRequestHandler):
    """Answers one request after the other of one connection."""

    protocol_version = "HTTP/1.1"
    server: PageServer

    def __init__(self, model: PageModel, title: str, *args: Any) -> None:
        self._model, self._title = model, title
        super().__init__(*args)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002, as in the base class
        """Log nothing."""

    def do_GET(self) -> None:
        """Answer with the page, a file of it, its values, or the next message."""
        name, query = self._name()
        if name == "":
            self._answer(PAGE.format(title=escape(self._title)).encode(), "text/html; charset=utf-8")
        elif name in FILES:
            self._answer((Path(__file__).parent / name).read_bytes(), TYPES[Path(name).suffix])
        elif name == "state":
            self._answer(json.dumps(self._model.state).encode(), "application/json")
        elif name == "next" and (after := query.get("after", [""])[0]).isdecimal():
            message = self._model.message_after(int(after), PATIENCE)
            if message is None:
                self._answer(b"", "", HTTPStatus.NO_CONTENT)
            else:  # the length of the text, the text, and the image
                text = json.dumps({"number": message.number, "content": message.content}).encode()
                self._answer(len(text).to_bytes(4, "big") + text + message.data, "application/octet-stream")
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Pass a change or a message on."""
        name, _ = self._name()
        length = self.headers.get("Content-Length", "")
        if name not in ("change", "send"):
            self._refuse(HTTPStatus.NOT_FOUND)
            return
        if not length.isdecimal() or int(length) > MOST:
            self._refuse(HTTPStatus.BAD_REQUEST)
            return
        try:
            values = json.loads(self.rfile.read(int(length)))
            if not isinstance(values, dict):
                raise OptionError("expected an object")
            (self._model.change if name == "change" else self._model.receive)(values)
        except (ValueError, RecursionError) as error:  # an OptionError is a ValueError
            self._answer(str(error).encode(), "text/plain; charset=utf-8", HTTPStatus.BAD_REQUEST)
        else:
            self._answer(b"", "", HTTPStatus.NO_CONTENT)

    def _name(self) -> tuple[str | None, dict[str, list[str]]]:
        """Name and query of what is asked for; None where the host or the secret path is wrong."""
        address = urlsplit(self.path)
        hosts = [f"{host}:{self.server.server_port}" for host in (HOST, "localhost")]
        given = address.path.encode("utf-8", "surrogateescape")
        root = self.server.root.encode()
        known = secrets.compare_digest(given[: len(root)], root) and self.headers.get("Host") in hosts
        return address.path[len(root) :] if known else None, parse_qs(address.query)

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True  # what the request may still contain is not read
        self._answer(status.phrase.encode(), "text/plain", status)

    def _answer(self, body: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)
