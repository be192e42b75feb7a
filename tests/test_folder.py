import os

import pytest

from raytrace.errors import FileError
from raytrace.output_folder import check_folder, write


def test_a_folder_is_made_with_those_above_it(tmp_path):
    check_folder(tmp_path / "a" / "b")
    check_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()


def test_a_file_in_its_place_is_a_clear_error(tmp_path):
    (tmp_path / "a").touch()
    with pytest.raises(FileError, match=r"a: can't be made: .*; choose another folder"):
        check_folder(tmp_path / "a")


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="no folder is closed to this user")
def test_a_closed_folder_is_a_clear_error(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FileError, match="no permission to write there"):
        check_folder(tmp_path)


def test_files_replace_older_ones_and_leave_nothing_else(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"older")
    assert write(tmp_path, {"a.txt": b"new", "b.txt": b"other"}) == (tmp_path / "a.txt", tmp_path / "b.txt")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.txt": b"new", "b.txt": b"other"}


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(FileError, match=r"a\.txt: can't be written"):
        write(tmp_path, {"a.txt": b"new"})
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
