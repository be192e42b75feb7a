from pathlib import Path

import pytest

import raytrace


def pytest_configure(config):
    if not Path(raytrace.__file__).is_relative_to(config.rootpath):  # pytest's own script looks for it elsewhere first
        raise pytest.UsageError(f"raytrace comes from {raytrace.__file__}: run python -m pytest")
