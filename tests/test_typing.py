"""Our types reach the programs that use them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy", reason="checks types: pip install mypy")

ROOT = Path(__file__).parents[1]
PROGRAM = """\
import numpy as np
import raytrace as rt

scene = rt.load("scene.json")
image = rt.render(scene, spp=4, size=(64, 64), aov=("depth",))
image.save("a.png")
hits = rt.BVH(np.zeros((3, 3)), np.array([[0, 1, 2]])).closest_hit(np.zeros((1, 3)), np.ones((1, 3)))
reveal_type(image)
reveal_type(hits)
reveal_type(rt.compare(image, image).rmse)
rt.show.bvh(scene)
rt.render(scene, spp="4")  # wrong
rt.render(scene, size=64)  # wrong
rt.load(3)  # wrong
rt.rendr(scene)  # wrong
"""


def test_a_type_checker_finds_mistakes_in_a_program_that_uses_the_package(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--follow-imports=silent", "--no-error-summary", "program.py"],
        capture_output=True,
        text=True,
        timeout=1200,
        cwd=tmp_path,
        env={**os.environ, "MYPYPATH": str(ROOT)},
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 1, done.stdout + done.stderr
    found = {int(re.match(r"program\.py:(\d+): error", line)[1]) for line in lines if ": error:" in line}
    assert found == {n for n, line in enumerate(PROGRAM.splitlines(), 1) if line.endswith("# wrong")}, done.stdout
    for name in ("raytrace.rendering.result.Render", "raytrace.records.Hits", "float"):  # and not Any
        assert any(re.search(rf'Revealed type is ".*\b{name}\b', line) for line in lines), done.stdout
