"""Files that are written whole, or not at all."""

import os

import pytest

from raytrace import files
from raytrace.errors import FileError
from raytrace.files import unfinished, write_whole


class HeldError(PermissionError):
    """What Windows says while a scanner reads a file."""

    def __init__(self, winerror=32):
        super().__init__(13, "The process cannot access the file because it is being used by another process")
        self.winerror = winerror


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(files, "PAUSE", 0.0)


def failing(monkeypatch, errors):
    """Have `os.replace` fail with these errors, then succeed; a list that grows by each call."""
    replace, calls = os.replace, []

    def replacing(*names):
        calls.append(names)
        if len(calls) <= len(errors):
            raise errors[len(calls) - 1]
        replace(*names)

    monkeypatch.setattr(os, "replace", replacing)
    return calls


def test_the_content_is_all_there_and_nothing_else(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"an older and longer file")
    write_whole(path, b"one", b"", b" two")
    assert path.read_bytes() == b"one two"
    assert [each.name for each in tmp_path.iterdir()] == ["a"]
    assert not unfinished


@pytest.mark.parametrize("winerror", [5, 32])
def test_a_file_that_a_scanner_holds_is_tried_again(tmp_path, monkeypatch, winerror):
    calls = failing(monkeypatch, [HeldError(winerror)] * 7)
    write_whole(tmp_path / "a", b"content")
    assert len(calls) == 8
    assert (tmp_path / "a").read_bytes() == b"content"
    assert [each.name for each in tmp_path.iterdir()] == ["a"]


def test_a_file_that_is_held_for_ever_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "PATIENCE", 0.01)
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(HeldError()))
    path = tmp_path / "a"
    path.write_bytes(b"older")
    with pytest.raises(FileError, match="a: can't be written: The process cannot access the file"):
        write_whole(path, b"content")
    assert path.read_bytes() == b"older"
    assert [each.name for each in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), PermissionError(13, "denied"), HeldError(3)])
def test_any_other_error_is_told_at_once(tmp_path, monkeypatch, error):
    calls = failing(monkeypatch, [error] * 9)
    with pytest.raises(FileError, match="can't be written: "):
        write_whole(tmp_path / "a", b"content")
    assert len(calls) == 1
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_no_temporary_file(tmp_path, monkeypatch):
    calls = failing(monkeypatch, [KeyboardInterrupt()])
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a", b"content")
    assert (len(calls), list(tmp_path.iterdir()), len(unfinished)) == (1, [], 0)


def test_images_and_checkpoints_are_tried_again_too(tmp_path, monkeypatch):
    import raytrace as rt
    from small_scenes import studio

    for name, act in {
        "a.png": lambda path: rt.render(studio(), size=(8, 8), spp=1).save(path),
        "a.checkpoint": lambda path: rt.render(studio(), size=(8, 8), spp=1, checkpoint=path),
    }.items():
        with monkeypatch.context() as patch:
            calls = failing(patch, [HeldError()] * 3)
            act(tmp_path / name)
            assert len(calls) == 4
        assert (tmp_path / name).exists()
