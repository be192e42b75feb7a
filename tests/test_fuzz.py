"""Hostile files: each ends in a right picture or in one clear line. Thousands more by hand: ``tests/fuzz/run.py``."""

import json
import sys
from pathlib import Path

import attributes
import cases
import lies
import pytest
import seeds
import textures
from mill import DIFFERENT, DONE, FILE, Case, Mill
from run import structured

from raytrace.jit import PLAIN

CORPUS = sorted((Path(__file__).parent / "fuzz" / "corpus").iterdir())
pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="memory is measured by /proc"),
    pytest.mark.skipif(PLAIN, reason="kernels are plain functions"),
]


@pytest.fixture(scope="module")
def mill():
    with Mill() as mill:
        yield mill


def case_of(path: Path) -> Case:
    """What a file of the corpus is for."""
    name, data = path.name, path.read_bytes()
    if path.suffix == ".json":
        return cases.scene_text(data, name)
    kind = name.partition(".")[2]
    if kind == "jpg":
        return textures.case(name, data, name)
    if kind in ("exr", "npz", "png"):
        files = {name: data, f"right.{kind}": seeds.pictures()[f"a.{kind}"]}
        return Case(files, ["compare", *files], name, codes=(DONE, FILE, DIFFERENT))
    files = {"scene.json": json.dumps(cases.scene_of(name)).encode(), name: data}
    return Case(files, ["scene.json", "-o", cases.PICTURE, *cases.SIZE], name, True, output=cases.PICTURE)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_was_found_once_is_not_found_again(mill, path):
    assert mill.grind(case_of(path)) == ""


def test_the_right_files_end_in_right_pictures(mill):
    before = mill.counts[DONE]
    for name, data in cases.MESHES.items():
        files = {"scene.json": json.dumps(cases.scene_of(name)).encode(), name: data}
        case = Case(files, ["scene.json", "-o", cases.PICTURE, *cases.SIZE], name, True, output=cases.PICTURE)
        assert mill.grind(case) == ""
    right, odd = cases.pictures()
    for name, data in right.items():
        assert mill.grind(Case({name: data}, ["compare", name, name], codes=(DONE,))) == ""
    assert mill.counts[DONE] - before == len(cases.MESHES) + len(right)
    for name, data in odd.items():
        assert mill.grind(Case({name: data}, ["compare", name, name], codes=(FILE,))) == ""
    found = [mill.grind(textures.case(name, data, name)) for name, data in cases.texture_files().items()]
    assert not any(found)


def test_right_meshes_with_attributes_are_loaded(mill):
    before = mill.counts[DONE]
    for name, data in attributes.MESHES.items():
        assert mill.grind(attributes.case(name, data, name)) == ""
    assert mill.counts[DONE] - before == len(attributes.MESHES)


@pytest.mark.parametrize("make", [cases.mesh, attributes.attributes, cases.scene_bytes, cases.picture, cases.texture])
def test_files_mutated_by_bytes(mill, make):
    assert [fault for k in range(150) if (fault := mill.grind(make(1000, k)))] == []


def test_scenes_mutated_by_structure(mill):
    faults = []
    structured(100, 1000, lambda case: faults.append(mill.grind(case)))
    assert [fault for fault in faults if fault] == []
    assert len(faults) >= 50


@pytest.mark.parametrize("kind", ["plys", "glbs", "stls"])
def test_headers_that_lie(mill, kind):
    name = f"a.{kind[:3]}"
    slow = ("a long chain of nodes", "ten million parts of a mesh", "a header without an end")
    files = [(about, data) for about, data in getattr(lies, kind)() if about not in slow]
    assert [fault for about, data in files if (fault := mill.grind(lies.scene(name, data, about)))] == []


BROKEN = """
import os, time
from raytrace.cli import main as cli
def main(words):
    if words[0] == "raise": raise ValueError("x")
    if words[0] == "hang": time.sleep(60)
    if words[0] == "crash": os.kill(os.getpid(), 11)
    if words[0] == "memory": bytearray(2**27)
    if words[0] == "half": open("picture.npz.tmp", "w").close()
    if words[0] == "stray": os.write(2, b"from C")
    if words[0] != "silent": print("scene.json: wrong" + "!" * 1000 * (words[0] == "verbose"), file=sys.stderr)
    return {"no picture": 0, "internal": 1}.get(words[0], 3)
cli.main = main
"""


def test_the_mill_finds_what_is_wrong(monkeypatch):
    """A traceback, a hang, a crash, memory, a half-written file, silence: each is seen, and the mill goes on."""
    monkeypatch.setattr("mill.SECONDS", 4.0)
    told = {
        "raise": "raised ValueError",
        "internal": "exit code 1",
        "hang": "took more than 4 s",
        "crash": "ended with -11",
        "memory": "took 12",
        "half": "left {'picture.npz.tmp'} behind",
        "stray": "by itself: from C",
        "verbose": "no clear line",
        "silent": "says nothing",
        "no picture": "wrote no picture",
    }
    with Mill(program=BROKEN) as broken:
        for kind, text in told.items():
            case = cases.scene_text(b"{}", kind)
            assert text in broken.grind(case._replace(words=[kind, *case.words], judge=False)), kind
        assert broken.grind(case._replace(words=["right"])) == ""


def test_the_same_seed_gives_the_same_cases():
    assert cases.mesh(3, 5) == cases.mesh(3, 5) != cases.mesh(3, 6)
    drawn = [[], []]
    for texts in drawn:
        structured(20, 7, lambda case, texts=texts: texts.append(case.files["scene.json"]))
    assert drawn[0] == drawn[1]
