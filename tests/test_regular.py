"""Only regular files are opened: before, by name, and after, whatever the name leads to by then."""

import os
import socket
import stat
import sys
from pathlib import Path

import pytest

from raytrace import files
from raytrace.errors import FileError
from raytrace.files import check_regular, open_regular

posix = pytest.mark.skipif(os.name != "posix", reason="no FIFOs")
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="no /proc")


@posix
def test_a_file_is_read_through_links(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with open_regular(tmp_path / "a") as stream, open_regular(str(tmp_path / "link")) as other:
        assert stream.read() == other.read() == b"abc"
        assert os.fstat(stream.fileno()).st_size == 3
        assert os.get_blocking(stream.fileno())
        assert not os.get_inheritable(stream.fileno())


def refused(path, what="a mesh file"):
    """What is said of a path, by its name and opened."""
    before = len(os.listdir("/proc/self/fd")) if sys.platform.startswith("linux") else 0
    with pytest.raises(FileError) as by_name:
        check_regular(path, what)
    with pytest.raises(FileError) as opened:
        open_regular(path, what)
    after = len(os.listdir("/proc/self/fd")) if sys.platform.startswith("linux") else 0
    assert str(by_name.value) == str(opened.value)
    assert before == after
    return str(opened.value)


@posix
def test_what_is_no_file_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket may not be long
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    with socket.socket(socket.AF_UNIX) as made:
        made.bind("socket")
        assert refused(tmp_path / "socket").endswith("socket: a socket, no regular file; name a mesh file")
    assert refused(tmp_path / "pipe").endswith("pipe: a FIFO, no regular file; name a mesh file")
    assert refused(tmp_path / "link").endswith("link: a FIFO, no regular file; name a mesh file")
    assert refused(tmp_path, "a scene").endswith(": a directory; name a scene in it")
    assert refused("/dev/zero") == "/dev/zero: a character device, no regular file; name a mesh file"


@linux
@pytest.mark.parametrize(
    "path", ["/proc/self/status", "/proc/version", "/sys/kernel/notes", "/proc/self/root/proc/version"]
)
def test_virtual_files_are_refused(path):
    if not os.path.exists(path):
        pytest.skip("not there")
    assert "a virtual file, no regular file" in refused(path)


@linux
def test_a_link_into_proc_is_refused(tmp_path):
    (tmp_path / "mesh.obj").symlink_to("/proc/self/maps")
    assert "a virtual file" in refused(tmp_path / "mesh.obj")


@linux
def test_a_file_that_another_name_in_proc_leads_to_is_one(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    with open(tmp_path / "a", "rb") as held, open_regular(f"/proc/self/fd/{held.fileno()}") as stream:
        assert stream.read() == b"abc"


@linux
@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="no /dev/shm")
def test_files_in_memory_are_ordinary():
    path = Path(f"/dev/shm/raytrace-test-{os.getpid()}")
    try:
        path.write_bytes(b"abc")
        with open_regular(path) as stream:
            assert stream.read() == b"abc"
    finally:
        path.unlink(missing_ok=True)


@posix
@pytest.mark.parametrize("target", ["pipe", "/dev/zero", "/proc/self/status", "."])
def test_a_link_swapped_after_the_check_is_seen(tmp_path, monkeypatch, target):
    if not os.path.exists(target) and target.startswith("/"):
        pytest.skip("not there")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "a").write_bytes(b"abc")
    link = tmp_path / "link"
    link.symlink_to("a")
    check = files.check_regular

    def swap(path, what):
        check(path, what)
        link.unlink()
        link.symlink_to(target)

    monkeypatch.setattr(files, "check_regular", swap)
    with pytest.raises(FileError, match=r"regular file|a directory"):
        open_regular(link)


@posix
def test_it_holds_where_descriptors_have_no_names(tmp_path, monkeypatch):
    def missing(path):
        raise FileNotFoundError(path)

    monkeypatch.setattr(os, "readlink", missing)
    (tmp_path / "a").write_bytes(b"abc")
    with open_regular(tmp_path / "a") as stream:
        assert stat.S_ISREG(os.fstat(stream.fileno()).st_mode)


@pytest.mark.parametrize("name", ["missing", "null\0character", "n" * 5000, "a/b"])
def test_what_the_system_says_is_left_to_the_caller(tmp_path, name):
    (tmp_path / "a").write_bytes(b"abc")
    with pytest.raises(OSError, match=r"\[Errno") as raised:
        open_regular(tmp_path / name)
    assert not isinstance(raised.value, FileError)
    assert raised.value.strerror
