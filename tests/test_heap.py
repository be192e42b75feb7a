"""Memory that one image frees and the next one takes: without new pages, which cost as much as a small image."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest

BOX = Path(__file__).parents[1] / "scenes/cornell-box.json"
PROGRAM = """
import resource, sys
import raytrace as rt

def pages():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

scene = rt.load(sys.argv[1])
for _ in range(3):
    rt.render(scene, size=(256, 256), spp=1, threads=2)
before = pages()
for _ in range(10):
    rt.render(scene, size=(256, 256), spp=1, threads=2)
print(pages() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library decides otherwise what to keep")
def test_the_next_image_takes_the_memory_of_the_last():
    words = [sys.executable, "-c", PROGRAM, str(BOX)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert int(said) < 5000  # 25,000 without
