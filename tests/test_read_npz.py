"""NPZ files of every kind: the arrays that they hold, or one line that says why not; never a warning."""

import io
import lzma
import warnings
import zipfile

import numpy as np
import pytest

from raytrace.errors import FileError
from raytrace.image import files

RGB = np.random.default_rng(0).random((5, 6, 3), np.float32)


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.npz"


def refused(path, **arrays):
    if arrays:
        np.savez(path, **arrays)
    with pytest.raises(FileError) as failure:
        files.load(path)
    line = str(failure.value)
    assert "\n" not in line
    assert len(line) < 500
    return line.removeprefix(f"{path}: ")


STRUCTURED = np.zeros((5, 6, 3), [("r", "f4"), ("g", "f4")])
REFUSED = {
    "structured": (STRUCTURED, "rgb: expected floats, got void64"),
    "complex": (RGB.astype(np.complex64), "rgb: expected floats, got complex64"),
    "bool": (RGB > 0.5, "rgb: expected floats, got bool"),
    "codes": ((255 * RGB).astype(np.uint8), "rgb: expected floats, got uint8"),
    "times": (np.zeros((5, 6, 3), "M8[s]"), "rgb: expected floats, got datetime64[s]"),
    "words": (np.full((5, 6, 3), "a"), "rgb: expected floats, got str32"),
    "bytes": (np.full((5, 6, 3), b"a"), "rgb: expected floats, got bytes8"),
    "a number": (np.float32(1.0), "not a valid NPZ image: rgb: expected shape (height, width, 3), got ()"),
    "no pixels": (RGB[:0], "not a valid NPZ image: rgb: expected shape (height, width, 3), got (0, 6, 3)"),
    "grey": (RGB[:, :, 0], "not a valid NPZ image: rgb: expected shape (height, width, 3), got (5, 6)"),
    "too large": (np.full((5, 6, 3), 1e39), "not a valid NPZ image: rgb: values that float32 can't hold"),
    "too small": (np.full((5, 6, 3), -1e300), "not a valid NPZ image: rgb: values that float32 can't hold"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_numbers_that_are_no_light_are_refused(path, name):
    array, words = REFUSED[name]
    assert refused(path, rgb=array) == words


def test_objects_are_refused(path):
    assert "rgb.npy contains Python objects (a pickle)" in refused(path, rgb=np.array([{}], dtype=object))
    nested = np.zeros((5, 6, 3), [("a", object)])
    assert "Python objects" in refused(path, rgb=nested)
    assert "Python objects" in refused(path, rgb=RGB, provenance=np.array({}, dtype=object))


@pytest.mark.parametrize(
    ("layer", "words"),
    [
        ({"samples": np.full((5, 6), 2**31)}, "samples: values that int32 can't hold"),
        ({"samples": np.full((5, 6), 2**64 - 1, np.uint64)}, "samples: values that int32 can't hold"),
        ({"prim_id": np.zeros((5, 6))}, "prim_id: expected whole numbers, got float64"),
        ({"depth": np.zeros((5, 6), np.int32)}, "depth: expected floats, got int32"),
        ({"stderr": np.zeros((5, 7))}, "stderr: expected shape (5, 6), as rgb has it"),
        ({"depth": np.full((5, 6), 1e39)}, "depth: values that float32 can't hold"),
    ],
)
def test_layers_are_looked_at_too(path, layer, words):
    assert words in refused(path, rgb=RGB, **layer)


def test_floats_of_other_sizes_and_orders_are_read(path):
    values = RGB.astype(np.float64)
    values[0, 0] = (np.nan, np.inf, -np.inf)
    values[0, 1] = (1e-300, np.finfo(np.float32).max, 0)
    for other in (values, values.astype(">f4"), values.astype(np.longdouble), np.asfortranarray(values.astype("<f4"))):
        np.savez(path, rgb=other, samples=np.full((5, 6), 7, np.uint8))
        held = files.load(path)
        assert held.rgb.dtype == np.float32
        assert held.rgb[0, 0, 1] == np.inf
        assert (held.rgb[1:] == RGB[1:]).all()
        assert (held.aov["samples"] == 7).all()
    np.savez(path, rgb=np.float16(RGB))
    assert (files.load(path).rgb == np.float16(RGB)).all()


@pytest.mark.parametrize(
    ("provenance", "words"),
    [
        (np.array(3), "provenance: expected a text, got int64 of shape ()"),
        (np.array(["{}"]), "provenance: expected a text, got str64 of shape (1,)"),
        (np.array(b"{}"), "provenance: expected a text, got bytes16 of shape ()"),
        (np.array("[1, 2]"), "provenance: expected a JSON object"),
        (np.array("seven"), "its text provenance is not valid JSON; remove it"),
        (np.array("[" * 9000), "its text provenance is not valid JSON; remove it"),
        (np.array('{"a": ' + "9" * 5000 + "}"), "its text provenance is not valid JSON; remove it"),
    ],
)
def test_a_provenance_is_a_json_object(path, provenance, words):
    assert refused(path, rgb=RGB, provenance=provenance) == words


def members(path, method, **arrays):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, array in arrays.items():
            stream = io.BytesIO()
            np.save(stream, array)
            file.writestr(f"{name}.npy", stream.getvalue())
    return path.read_bytes()


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_of_every_compression_are_read_or_refused(path, method):
    whole = members(path, method, rgb=RGB)
    assert (files.load(path).rgb == RGB).all()
    start, end, lost = 30 + len("rgb.npy"), whole.index(b"PK\1\2"), 0
    for at in range(start, end, 7):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        try:
            assert (files.load(path).rgb == RGB).all()  # a byte that says nothing
        except FileError:
            lost += 1
    assert lost >= (end - start) // 7 - 3


def test_a_corrupt_lzma_member_is_one_line(path):
    whole = members(path, zipfile.ZIP_LZMA, rgb=RGB)
    at = 30 + len("rgb.npy") + 9
    path.write_bytes(whole[:at] + b"\xff" * 40 + whole[at + 40 :])
    assert refused(path).startswith("not a valid NPZ image: ")
    with pytest.raises(lzma.LZMAError), zipfile.ZipFile(path) as file:
        file.read("rgb.npy")


def header(text):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        data = b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + bytes(360)
        file.writestr("rgb.npy", data)
    return stream.getvalue()


@pytest.mark.parametrize(
    "text",
    [
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (-5, -6, 3)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (5, 6, 3, 0)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000, 6, 3)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (10000000000000000000000, 0, 3)}",
        b"{'descr': '<f4', 'fortran_order': 2, 'shape': (5, 6, 3)}",
        b"{'descr': '<f4', 'shape': (5, 6, 3)}",
        b"{'descr': '<f400', 'fortran_order': False, 'shape': (5, 6, 3)}",
        b"{'descr': [('a', '<f4', (5,))], 'fortran_order': False, 'shape': (1, 6, 3)}",
        b"{'descr': '<f4', 'fortran_order': False, 'shape': (True, 6, 3)}",
        b"{'descr': '|V0', 'fortran_order': False, 'shape': (5, 6, 3)}",
        b"{'descr': '<U0', 'fortran_order': False, 'shape': (5, 6, 3)}",
        b"(" * 5000,
        b" " * 20_000,
        b"",
    ],
)
def test_headers_that_lie_are_one_line(path, text):
    path.write_bytes(header(text))
    assert refused(path)


def test_a_header_of_python_2_is_read_without_a_warning(path):
    path.write_bytes(header(b"{'descr': '<f4', 'fortran_order': False, 'shape': (5L, 6L, 3L)}"))
    assert files.load(path).rgb.shape == (5, 6, 3)


def test_a_member_that_is_encrypted_or_twice_there_is_no_traceback(path):
    whole = bytearray(members(path, zipfile.ZIP_STORED, rgb=RGB))
    whole[6] |= 1
    whole[whole.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(whole)
    assert refused(path).startswith("not a valid NPZ image: ")


def test_saving_refuses_what_a_file_would_not_give_back(tmp_path):
    for wrong, words in ((1e39, "values that float32 can't hold"), (1j, "expected numbers, got complex128")):
        for name in ("a.npz", "a.exr", "a.png"):
            with pytest.raises(ValueError, match=words):
                files.save(tmp_path / name, np.full((2, 2, 3), wrong))
    with pytest.raises(ValueError, match="samples: values that int32 can't hold"):
        files.save(tmp_path / "a.npz", RGB, aov={"samples": np.full((5, 6), 0.5)})
    assert list(tmp_path.iterdir()) == []
