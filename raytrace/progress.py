"""How far a render is."""

from typing import NamedTuple


class Progress(NamedTuple):
    """One message of a running render."""

    stage: str  # "compiling", "building" or "rendering"
    done: int  # finished parts
    total: int  # all parts
    rays: int  # traced so far, of all kinds
    seconds: float  # since the stage began
