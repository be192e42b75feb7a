"""Checkpoints whose checksums are right and whose content is not: the image is drawn all the same, in one line."""

import json
import random

import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import FileError
from raytrace.rendering import checkpoint, checkpoint_header, run
from raytrace.rendering.checkpoint import FOREIGN, TILING, Checkpoint
from raytrace.rendering.journal import HEAD, _head
from same_pictures import assert_same
from small_scenes import studio

ASK = {"size": (40, 33), "spp": 16}
DEEP = b"[" * 100_000


@pytest.fixture(scope="module")
def scene():
    return studio()


@pytest.fixture(scope="module")
def whole(scene):
    return rt.render(scene, **ASK)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.png.checkpoint"


@pytest.fixture(autouse=True)
def always(monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)
    monkeypatch.setattr(run, "BATCH", 1 << 14)  # small work items, so that an image has several


def records(content):
    """(number, content) of each record of a file."""
    found = []
    while content:
        _, number, length = HEAD.unpack(content[: HEAD.size])
        found.append((number, content[HEAD.size : HEAD.size + length]))
        content = content[HEAD.size + length :]
    return found


def journal(*parts):
    return b"".join(_head(number, content) + content for number, content in parts)


def kept(scene, file):
    """The records of a file from which the image could go on."""
    rt.render(scene, checkpoint=file, threads=1, **ASK)
    found = records(file.read_bytes())
    assert [number for number, _ in found] == [0, TILING, *range(len(found) - 2)]
    return found


def resumed(scene, file):
    said = []
    picture = rt.render(scene, checkpoint=Checkpoint(file, True, said.append), **ASK)
    return picture, said


def edited(title, **changes):
    return json.dumps({"picture": json.loads(title)["picture"] | changes}).encode()


TITLES = {
    "list": lambda _: b"[]",
    "number": lambda _: b"5",
    "text": lambda _: b'"picture"',
    "null": lambda _: b"null",
    "empty": lambda _: b"",
    "no UTF-8": lambda _: b"\xff\xfe",
    "no JSON": lambda _: b"{picture}",
    "deep": lambda _: DEEP,
    "many digits": lambda _: b"9" * 10_000,
    "nothing": lambda _: b"{}",
    "a list as picture": lambda _: b'{"picture": []}',
    "an empty picture": lambda _: b'{"picture": {}}',
    "size": lambda title: edited(title, size=None),
    "shorter size": lambda title: edited(title, size=[40]),
    "texts in crop": lambda title: edited(title, crop=["0", "0", "40", "33"]),
    "spp": lambda title: edited(title, spp="16"),
    "seed": lambda title: edited(title, seed=True),
    "target": lambda title: edited(title, target_error=[]),
    "sources": lambda title: edited(title, sources=7),
    "format": lambda title: edited(title, format="2"),
    "one more": lambda title: edited(title, colour="red"),
}
LAYOUTS = {
    "list": b"[]",
    "deep": DEEP,
    "no UTF-8": b"\xff",
    "too few": b'{"first": 0}',
    "too many": b'{"first": 0, "leap": 2, "at_least": 0, "work": 0, "more": 0}',
    "text": b'{"first": "0", "leap": 2, "at_least": 0, "work": 0}',
    "float": b'{"first": 1.0, "leap": 2, "at_least": 0, "work": 0}',
    "flag": b'{"first": true, "leap": 2, "at_least": 0, "work": 0}',
    "null": b'{"first": null, "leap": 2, "at_least": 0, "work": 0}',
    "negative": b'{"first": -1, "leap": 2, "at_least": 0, "work": 0}',
    "leap": b'{"first": 0, "leap": 0, "at_least": 0, "work": 0}',
    "more than there are": b'{"first": 17, "leap": 2, "at_least": 0, "work": 0}',
    "huge": b'{"first": 0, "leap": 2, "at_least": 99999999999999999999, "work": 0}',
}


@pytest.mark.parametrize("what", TITLES)
def test_another_title_is_no_checkpoint_of_this_image(scene, whole, file, what):
    (_, title), *rest = kept(scene, file)
    file.write_bytes(journal((0, TITLES[what](title)), *rest))
    picture, said = resumed(scene, file)
    assert said == [f"{file}: {FOREIGN}"]
    assert_same(whole, picture)
    picture, said = resumed(scene, file)  # the new one is sound
    assert len(said) == 1
    assert "resuming from" in said[0]
    assert_same(whole, picture)


@pytest.mark.parametrize("what", LAYOUTS)
def test_another_layout_is_no_checkpoint_of_this_image(scene, whole, file, what):
    title, _, *parts = kept(scene, file)
    file.write_bytes(journal(title, (TILING, LAYOUTS[what]), *parts))
    picture, said = resumed(scene, file)
    assert said == [f"{file}: {FOREIGN}"]
    assert_same(whole, picture)


def test_parts_without_a_layout_are_no_checkpoint_of_this_image(scene, whole, file):
    title, _, *parts = kept(scene, file)
    file.write_bytes(journal(title, *parts))
    picture, said = resumed(scene, file)
    assert said == [f"{file}: {FOREIGN}"]
    assert_same(whole, picture)


def test_a_title_alone_is_where_a_render_was_killed_before_it_began_to_draw(scene, whole, file):
    title, *_ = kept(scene, file)
    file.write_bytes(journal(title))
    picture, said = resumed(scene, file)
    assert said == [f"{file}: resuming from 0 finished work items"]
    assert_same(whole, picture)
    assert len(records(file.read_bytes())) > 2


@pytest.mark.parametrize("content", [b"", b"few", bytes(96), bytes(97), bytes(96 * 7), b"\xff" * 960])
def test_a_record_that_holds_something_else_is_drawn_again(scene, whole, file, content):
    title, layout, *parts = kept(scene, file)
    number = parts[0][0]
    strange = [(number, content), (0xFFFFFFFE, content), (number + 10_000, content)]
    file.write_bytes(journal(title, layout, *parts[1:], *strange))
    picture, _ = resumed(scene, file)
    assert_same(whole, picture)
    assert picture.stats["rays"]["camera"] < whole.stats["rays"]["camera"]  # nothing else is lost


@pytest.mark.parametrize("seed", range(40))
def test_titles_of_any_content_end_in_an_image_or_in_one_line(scene, whole, file, seed):
    draw = random.Random(seed)
    (_, title), layout, *parts = kept(scene, file)
    values = [None, True, -1, 0, 1e400, float("nan"), "x\n\x1b[31m", "y" * 500, [], [[]], {}, {"a": 1}, 10**30]
    picture = json.loads(title)["picture"]
    for name in draw.sample(sorted(picture), 2):
        picture[name] = draw.choice(values)
    file.write_bytes(journal((0, json.dumps({"picture": picture}).encode()), layout, *parts))
    try:
        drawn, said = resumed(scene, file)
    except FileError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert refused.startswith(f"{file}: belongs to another image (")
        assert refused.isprintable()
        assert len(refused) < 1000
    else:
        assert said in ([f"{file}: {FOREIGN}"], [f"{file}: resuming from {len(parts)} finished work items"])
        assert_same(whole, drawn)


def test_without_resume_such_a_file_is_left_alone_for_a_while(scene, whole, file):
    content = journal((0, b"[]"))
    file.write_bytes(content)
    said = []
    assert_same(whole, rt.render(scene, checkpoint=Checkpoint(file, False, said.append), **ASK))
    assert said == [f"{file}: {FOREIGN}"]
    assert file.read_bytes() == content


def test_a_file_that_is_no_regular_one_is_refused(scene, tmp_path):
    with pytest.raises(FileError, match="a directory"):
        rt.render(scene, checkpoint=tmp_path, **ASK)


def test_what_is_told_of_another_picture_fits_in_a_line():
    told = checkpoint_header.differences({"a": 1, "b": "x", "scene": "s"}, {"a": "\n" * 99, "b": "x", "scene": "t"})
    assert told.startswith(r"a \n\n")
    assert told.endswith("..., not 1, another scene")
    assert len(told) < 100


def test_nothing_was_drawn_of_a_kept_image(scene, whole, file):
    kept(scene, file)
    picture, _ = resumed(scene, file)
    assert picture.stats["rays"] == {}
    assert np.array_equal(picture.rgb, whole.rgb)
