"""The marker ``busy`` finds tests that a busy machine may disturb, and leaves the others alone."""

import pytest

from busy import FOLDER, busy_in, busy_names

SOURCE = '''
import pytest
from helper import started, quick

PROGRAM = "import time; time.sleep(1)"

@pytest.fixture
def process():
    return subprocess.Popen(["true"])

def run(program):
    return exec(program)

class Desk:
    def wait(self):
        self.event = threading.Event()

def test_of_a_fixture(process): ...
def test_of_a_class(): Desk().wait()
def test_of_a_program(): run(PROGRAM)
def test_of_an_import(): started()
def test_of_a_signal(): os.kill(os.getpid(), signal.SIGTERM)
@pytest.mark.parametrize("x", [1])
def test_of_a_limit(x): render(time_limit=1.0)
def test_of_numbers():
    """Says timeout=3, and subprocess."""
    assert quick(1) == 2  # sleep(1)
def test_of_a_plain_helper(): run("1")
'''


def test_busy_names_are_found_through_helpers_fixtures_and_imports():
    busy = busy_names(SOURCE, {"helper": frozenset({"started"})})
    tests = {name for name in busy if name.startswith("test_")}
    assert tests == {
        "test_of_a_fixture", "test_of_a_class", "test_of_a_program", "test_of_an_import", "test_of_a_signal",
        "test_of_a_limit",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("file", "busy", "other"),
    [
        ("test_parallel.py", "test_an_interrupt_waits_for_what_is_under_way", "test_reports_come"),
        ("test_jit.py", "test_kernels_let_go_of_the_interpreter", ""),
        ("test_workers.py", "test_ctrl_c_ends_them_at_once", ""),
        ("test_precision.py", None, "test_the_bound_is_stated"),
        ("test_coincident.py", None, "test_the_lift_scales_with_the_scene"),
    ],
)
def test_tests_of_the_suite_are_told_apart(file, busy, other):
    found = busy_in(FOLDER / file)
    assert busy is None or busy in found
    assert other not in found


def test_this_file_has_the_marker_where_it_should(request):
    assert request.node.get_closest_marker("busy") is None
