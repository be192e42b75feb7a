"""Whom the store trusts, and what it does where nothing can be written."""

import contextlib
import logging
import os
import shutil
import stat
import sys

import pytest

from raytrace import doctor, files
from raytrace.native import private_files, store
from raytrace.native.link import Code

NAME, KINDS, CODE = "raytrace.passes.light.background", "float32[1C]", Code(("PyTuple_GetItem",), b"code")
posix = pytest.mark.skipif(not private_files.POSIX, reason="owners and modes are POSIX")


# Who may have written it ----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def umask(mask):
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


@posix
@pytest.mark.parametrize("mask", [0o000, 0o002, 0o077, 0o277])
def test_folders_and_files_are_the_users_alone_whatever_the_umask(fresh, mask):
    with umask(mask):
        assert store.keep(NAME, KINDS, CODE)
    assert [stat.S_IMODE(path.stat().st_mode) for path in (fresh().parent, fresh(), store.path_of(NAME, KINDS))] == [
        0o700, 0o700, 0o600
    ]  # fmt: skip
    assert store.find(NAME, KINDS) == CODE


@posix
@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702])
def test_a_folder_that_others_may_write_counts_as_empty(fresh, caplog, mode):
    store.keep(NAME, KINDS, CODE)
    fresh().chmod(mode)
    with caplog.at_level(logging.WARNING, "raytrace"):
        assert store.find(NAME, KINDS) is None
        assert not store.keep(NAME, "another", CODE)
        assert not store.can_keep()
    (line,) = caplog.messages
    assert f"can be written by other users (mode {mode:03o})" in line
    assert "NOT used" in dict(doctor.findings())["cache"]
    fresh().chmod(0o755)
    assert store.find(NAME, KINDS) == CODE
    assert [path.name for path in fresh().iterdir()] == [store.path_of(NAME, KINDS).name]


@posix
def test_a_file_that_others_may_write_is_compiled_anew(fresh, caplog):
    store.keep(NAME, KINDS, CODE)
    store.path_of(NAME, KINDS).chmod(0o666)
    with caplog.at_level(logging.WARNING, "raytrace"):
        assert store.find(NAME, KINDS) is None
    assert "can be written by other users (mode 666): it is compiled again" in caplog.text
    assert store.keep(NAME, KINDS, CODE)
    assert store.find(NAME, KINDS) == CODE


@posix
def test_what_belongs_to_another_user_counts_as_empty_and_what_belongs_to_root_does_not(fresh, monkeypatch, caplog):
    store.keep(NAME, KINDS, CODE)
    owner = fresh().stat().st_uid
    monkeypatch.setattr(private_files.os, "geteuid", lambda: owner + 1)
    found, kept = store.find(NAME, KINDS), store.keep(NAME, "another", CODE)
    if owner == 0:
        assert (found, kept) == (CODE, True)
    else:
        assert (found, kept) == (None, False)
        assert f"belongs to another user (uid {owner})" in caplog.text
    status = os.stat_result((0o100600, 1, 1, 1, owner + 2, 0, 0, 0, 0, 0))
    assert private_files.distrust(status) == f"belongs to another user (uid {owner + 2})"
    assert private_files.distrust(os.stat_result((0o100600, 1, 1, 1, 0, 0, 0, 0, 0, 0))) == ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
def test_nothing_but_a_regular_file_is_opened(fresh, monkeypatch):
    store.keep(NAME, KINDS, CODE)
    path = store.path_of(NAME, KINDS)
    path.unlink()
    os.mkfifo(path)
    assert store.find(NAME, KINDS) is None
    regular = path.with_name("regular")
    regular.touch()
    real = os.stat  # as if it were swapped in between the look and the opening
    monkeypatch.setattr(os, "stat", lambda name, **more: real(regular if name == path.name else name))
    assert store.find(NAME, KINDS) is None
    monkeypatch.undo()
    for other in ("/dev/zero", "/dev/null"):
        path.unlink()
        path.symlink_to(other)
        with pytest.raises(OSError, match="not a regular file"):
            private_files.read(path)
    assert store.keep(NAME, KINDS, CODE)
    assert private_files.read(path)
    shutil.rmtree(path.parent)
    os.mkfifo(path.parent)
    assert store.find(NAME, KINDS) is None
    assert not store.keep(NAME, KINDS, CODE)


def test_a_file_that_a_scanner_holds_is_replaced_a_little_later(fresh, monkeypatch):
    calls, real = [], os.replace
    denied: OSError

    def held(*names):
        calls.append(names)
        if len(calls) < 4:
            raise denied
        real(*names)

    class WindowsError(PermissionError):
        winerror = 5

    monkeypatch.setattr(os, "replace", held)
    monkeypatch.setattr(files, "PAUSE", 0.0)
    fresh().mkdir(parents=True)
    denied = WindowsError(13, "Access is denied")
    assert store.keep(NAME, KINDS, CODE)
    assert len(calls) == 4
    calls.clear()
    denied = PermissionError(13, "Access is denied")
    assert not store.keep(NAME, KINDS, CODE)
    assert len(calls) == 1


# Full and read-only ---------------------------------------------------------------------------------------------------


def test_a_full_store_that_cannot_be_written_to_is_used_and_described_truly(fresh, monkeypatch):
    store.keep(NAME, KINDS, CODE)
    monkeypatch.setattr(private_files, "probe", lambda folder: "Read-only file system")
    assert store.find(NAME, KINDS) == CODE
    assert (
        "read-only: Read-only file system; every process compiles the kernels that are missing"
        in dict(doctor.findings())["cache"]
    )
    assert dict(doctor.findings())["kernels"] == "1 compiled"


@pytest.mark.skipif(sys.platform == "win32", reason="/dev/full")
def test_a_probe_notices_a_disk_without_room(tmp_path, monkeypatch):
    assert private_files.probe(tmp_path / "not" / "made") == ""
    real = open
    monkeypatch.setattr(private_files, "open", lambda *_: real("/dev/full", "wb", buffering=0), raising=False)
    assert private_files.probe(tmp_path) == "No space left on device"
    assert list(tmp_path.iterdir()) == []
