"""JupyterLab with a kernel of this folder's raytrace, in a real Chromium without a window."""

import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PATIENCE = 180  # s: kernels may have to be compiled
NO_NEWS = {"disabledExtensions": {"@jupyterlab/apputils-extension:announcements": True}}
NO_BUILD = {"buildCheck": False}  # packages with old extensions of JupyterLab bring a dialog


def why_not() -> str:
    """What is missing; nothing if a notebook can be opened."""
    for module in ("jupyterlab", "anywidget", "playwright"):
        if not any((Path(folder) / module).is_dir() for folder in sys.path):
            return f"needs {module}"
    return "" if _chromium() else "needs a Chromium"


def _chromium() -> str | None:
    names = "chromium", "chromium-browser", "google-chrome", "chrome"
    return next(filter(None, map(shutil.which, names)), None)


def write_notebook(path: Path, cells: Sequence[str]) -> None:
    """A notebook of code cells."""
    made = [
        {"cell_type": "code", "id": f"c{k}", "metadata": {}, "outputs": [], "execution_count": None, "source": cell}
        for k, cell in enumerate(cells)
    ]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    path.write_text(json.dumps({"cells": made, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}), "utf-8")


@contextmanager
def a_lab(folder: Path) -> Iterator[str]:
    """Serve a folder by JupyterLab; the address of its pages, up to their names."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    home, token = folder / ".jupyter", secrets.token_hex(16)
    (home / "labconfig").mkdir(parents=True)
    (home / "labconfig" / "page_config.json").write_text(json.dumps(NO_NEWS | NO_BUILD), "utf-8")
    places = {f"JUPYTER_{name}_DIR": str(home) for name in ("CONFIG", "DATA", "RUNTIME")}
    places["JUPYTERLAB_WORKSPACES_DIR"] = places["JUPYTERLAB_SETTINGS_DIR"] = str(home)
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", f"--ServerApp.port={port}"]
    command += [f"--ServerApp.root_dir={folder}", f"--IdentityProvider.token={token}"]
    with open(home / "log", "wb") as log:
        server = subprocess.Popen(
            command, env=os.environ | {"PYTHONPATH": str(ROOT), **places}, stdout=log, stderr=log, cwd=folder
        )
    try:
        _wait(f"http://127.0.0.1:{port}/api/status?token={token}", server, home / "log")
        yield f"http://127.0.0.1:{port}/lab/tree/{{}}?token={token}&reset"  # with no other page open
    finally:
        server.terminate()
        server.wait(timeout=30)


def _wait(address: str, server: Any, log: Path) -> None:
    limit = time.monotonic() + PATIENCE
    while True:
        try:
            urllib.request.urlopen(address, timeout=5).close()
        except OSError as error:
            if time.monotonic() > limit or server.poll() is not None:
                raise TimeoutError(f"JupyterLab doesn't answer: {error}\n{log.read_text()}") from error
            time.sleep(0.2)
        else:
            return


@contextmanager
def a_page(width: int = 1280, height: int = 900, scale: float = 1.0) -> Iterator[Any]:
    """A page of a browser; ``page.elsewhere`` lists what it asked other machines for, in vain."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as runner:
        browser = runner.chromium.launch(executable_path=_chromium(), args=["--no-sandbox"])
        size = {"width": width, "height": height}
        page = browser.new_page(viewport=size, device_scale_factor=scale)
        page.set_default_timeout(1000 * PATIENCE)
        page.elsewhere = []

        def elsewhere(route: Any) -> None:
            page.elsewhere.append(route.request.url)
            route.abort()

        page.route(lambda url: not url.startswith(("http://127.0.0.1", "data:", "blob:", "file:")), elsewhere)
        yield page
        browser.close()


def run_all(page: Any, address: str) -> None:
    """Open a notebook, and run all its cells from the menu, as a person would."""
    page.goto(address)
    page.get_by_text("Python 3 (ipykernel) | Idle").wait_for()
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
