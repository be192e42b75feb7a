import functools

import pytest

from golden_gate import check_golden


def pytest_addoption(parser):
    parser.addoption("--update-golden", action="store_true", help="write the pictures of tests/golden anew")


@pytest.fixture
def golden(request):
    """``golden(name, rgb)`` fails unless the picture passes the gate of tests/golden/<name>.npz."""
    return functools.partial(check_golden, update=request.config.getoption("--update-golden"))
