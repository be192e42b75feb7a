"""A real Jupyter kernel of this folder's raytrace: cells are run in it, and interrupted."""

import os
import queue
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PATIENCE = 300  # s: kernels may have to be compiled


class Cells:
    """A running kernel.

    Attributes
    ----------
    messages : list of (str, dict)
        Type and content of all that the kernel published for the last cell.
    """

    def __init__(self, manager: Any, client: Any) -> None:
        self.manager, self.client = manager, client
        self.messages: list[tuple[str, dict[str, Any]]] = []

    def begin(self, code: str) -> None:
        """Let a cell run."""
        self.messages = []
        self._cell = self.client.execute(code)

    def until(self, kind: str) -> dict[str, Any]:
        """Wait until the cell publishes a message of this kind; its content."""
        limit = time.monotonic() + PATIENCE
        while time.monotonic() < limit:
            try:
                message = self.client.get_iopub_msg(timeout=1)
            except queue.Empty:
                continue
            if message["parent_header"].get("msg_id") == self._cell:
                content = message["content"]
                self.messages.append((message["msg_type"], content))
                if message["msg_type"] == kind and content.get("execution_state", "idle") == "idle":
                    return content
        raise TimeoutError(f"no {kind} within {PATIENCE} s, but {self.messages}")

    def finish(self) -> str:
        """Wait until the cell is done; what it printed."""
        self.until("status")
        wrong = [content["traceback"] for kind, content in self.messages if kind == "error"]
        assert not wrong, "\n".join(wrong[0])
        return "".join(self.each("stream", "text"))

    def each(self, kind: str, field: str) -> list[Any]:
        """One field of all messages of a kind."""
        return [content[field] for found, content in self.messages if found == kind]

    def run(self, code: str) -> str:
        """Run a cell; what it printed."""
        self.begin(code)
        return self.finish()


@contextmanager
def a_kernel(**variables: str) -> Iterator[Cells]:
    """Start a kernel, with more variables in its environment; skip the test where there is none to start."""
    jupyter_client = pytest.importorskip("jupyter_client", reason="needs ipykernel")
    pytest.importorskip("ipykernel", reason="needs ipykernel")
    manager = jupyter_client.KernelManager()
    manager.start_kernel(env=os.environ | {"PYTHONPATH": str(ROOT), **variables}, cwd=str(ROOT))
    client = manager.client()
    client.start_channels()
    try:
        client.wait_for_ready(timeout=PATIENCE)
        yield Cells(manager, client)
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
