from pathlib import Path

import pytest

import raytrace
from busy import FOLDER, busy_in
from raytrace.native import store


def pytest_configure(config):
    if not Path(raytrace.__file__).is_relative_to(config.rootpath):  # pytest's own script looks for it elsewhere first
        raise pytest.UsageError(f"raytrace comes from {raytrace.__file__}: run python -m pytest")


def pytest_collection_modifyitems(items):
    for item in items:
        function = getattr(item, "originalname", None)
        if function and item.path.suffix == ".py" and item.path.parent == FOLDER and function in busy_in(item.path):
            item.add_marker(pytest.mark.busy)


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """Forget what the store knows of the folder, now and whenever it is called."""

    def forget():
        for known in (store.cache_folder, store.touch, store._say):
            known.cache_clear()
        return store.cache_folder()

    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / "cache"))
    forget()
    yield forget
    monkeypatch.undo()
    forget()
