"""From a scene file to arrays: the format, its errors, its meshes."""

from pathlib import Path


def schema_text() -> str:
    """Return the JSON Schema of the scene format as shipped, without importing pydantic.

    Examples
    --------
    >>> schema_text().startswith("{")
    True
    """
    return Path(__file__).with_name("scene.schema.json").read_text("utf-8")
