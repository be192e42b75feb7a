"""EXR files that are known to be whole are read without a guard, and are never said to be broken."""

import os
import struct

import numpy as np
import pytest

from raytrace.errors import FileError
from raytrace.image import files, read_exr
from raytrace.image.exr_chunks import pixels_complete

OpenEXR = pytest.importorskip("OpenEXR")
PLANE = np.random.default_rng(0).random((37, 21), np.float32)


def made(tmp_path, plane=PLANE, **header):
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, {name: plane.copy() for name in "RGB"}) as file:
        file.write(str(tmp_path / "a.exr"))
    return (tmp_path / "a.exr").read_bytes()


@pytest.fixture
def unguarded(monkeypatch):
    """No file may be read under the guard."""

    def guard():
        raise AssertionError("stderr was redirected")

    monkeypatch.setattr(read_exr, "_muted", guard)


@pytest.mark.parametrize("compression", ["NO", "ZIPS", "ZIP"])
@pytest.mark.parametrize("dtype", ["f4", "f2"])
@pytest.mark.parametrize("flat", [False, True])
def test_common_files_are_known_to_be_whole(tmp_path, unguarded, compression, dtype, flat):
    plane = (0 * PLANE if flat else PLANE).astype(dtype)
    lies = np.array([-3, 5], np.int32), np.array([17, 41], np.int32)
    for order in (OpenEXR.INCREASING_Y, OpenEXR.DECREASING_Y):
        header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "lineOrder": order}
        data = made(tmp_path, plane, **header, dataWindow=lies, displayWindow=lies)
        assert pixels_complete(data)
        assert (files.load(tmp_path / "a.exr").rgb[:, :, 0] == plane).all()


def test_what_is_written_here_is_known_to_be_whole(tmp_path, unguarded):
    rgb = np.dstack([PLANE] * 3)
    layers = {"samples": np.ones(PLANE.shape, np.int32), "normal": rgb}
    path = files.save(tmp_path / "a.exr", rgb, stderr=PLANE, aov=layers, provenance={"seed": 1})
    assert pixels_complete(path.read_bytes())
    assert (files.load(path).rgb == rgb).all()


def test_of_other_kinds_nothing_is_known(tmp_path):
    for name in ("RLE", "PIZ", "PXR24", "B44", "DWAA"):
        assert not pixels_complete(made(tmp_path, compression=getattr(OpenEXR, f"{name}_COMPRESSION")))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    assert not pixels_complete(made(tmp_path, type=OpenEXR.tiledimage, tiles=tiles))
    for data in (b"", b"v/1\x01", b"v/1\x01\2\0\0\0", b"v/1\x01\2\0\0\0\0"):
        assert not pixels_complete(data)


@pytest.mark.parametrize("compression", ["NO", "ZIP"])
def test_what_is_known_to_be_whole_makes_no_noise(tmp_path, capfd, compression, monkeypatch):
    data = made(tmp_path, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    rng, known = np.random.default_rng(1), 0
    monkeypatch.setattr(read_exr, "_muted", lambda: pytest.fail("of what is broken nothing is decoded here"))
    for k in range(600):
        at = rng.integers(0, 600 if k % 2 else len(data))
        broken = data[:at] + bytes([rng.integers(256)]) + data[at + 1 :]
        if k % 5 == 0:
            broken = data[:at] + struct.pack("<i", rng.choice([0, -1, 1, 2**31 - 1])) + data[at + 4 :]
        if pixels_complete(broken):
            known += 1
            (tmp_path / "a.exr").write_bytes(broken)
            try:
                files.load(tmp_path / "a.exr")
            except FileError as error:
                known += "\n" in str(error)
    assert known > 20
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", [OpenEXR.PIZ_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
def test_a_broken_file_is_one_line_and_stderr_comes_back(tmp_path, capfd, compression):
    data = made(tmp_path, np.float32(np.arange(777) % 5).reshape(37, 21), compression=compression)
    (tmp_path / "a.exr").write_bytes(data[:-100] + bytes([255]) * 90 + data[-10:])
    with pytest.raises(FileError, match="not a valid EXR image"):
        files.load(tmp_path / "a.exr")
    os.write(2, b"heard")
    assert capfd.readouterr() == ("", "heard")
