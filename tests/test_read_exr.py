"""EXR files of every kind: the light that they hold, or one line that says why not."""

import numpy as np
import pytest

from raytrace.errors import FileError
from raytrace.image import files
from raytrace.image.metrics import compare

OpenEXR = pytest.importorskip("OpenEXR")
PLANE = np.random.default_rng(0).random((5, 6), np.float32)
COLOUR = {"R": PLANE, "G": 0.5 * PLANE, "B": 0.25 * PLANE}
BASE = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def corner(x, y):
    return np.array([x, y], np.int32)


def window(left, top, width=6, height=5):
    return corner(left, top), corner(left + width - 1, top + height - 1)


@pytest.fixture
def write(tmp_path):
    def to(name, channels, **header):
        path = tmp_path / name
        own = {key: np.array(plane) if isinstance(plane, np.ndarray) else plane for key, plane in channels.items()}
        with OpenEXR.File(BASE | header, own) as file:
            file.write(str(path))
        return path

    return to


def refused(path):
    with pytest.raises(FileError) as failure:
        files.load(path)
    line = str(failure.value)
    assert "\n" not in line
    return line.removeprefix(f"{path}: ")


def test_a_shifted_data_window_is_refused(write):
    path = write("a.exr", COLOUR, dataWindow=window(1, 0), displayWindow=window(0, 0, 8, 8))
    assert refused(path) == (
        "its data window (1, 0)-(6, 4) is not its display window (0, 0)-(7, 7); crop or pad it to that"
    )
    assert "data window" in refused(write("b.exr", COLOUR, dataWindow=window(0, 0), displayWindow=window(0, 0, 6, 6)))
    assert "data window" in refused(write("c.exr", COLOUR, dataWindow=window(-2, -2), displayWindow=window(0, 0, 2, 1)))


def test_windows_that_lie_elsewhere_together_are_read(write):
    path = write("a.exr", COLOUR, dataWindow=window(-3, 7), displayWindow=window(-3, 7))
    assert (files.load(path).rgb[:, :, 1] == 0.5 * PLANE).all()


@pytest.mark.parametrize("alpha", [0.0, 0.999, 2.0, np.nan])
@pytest.mark.parametrize("name", ["A", "AG"])
def test_an_alpha_below_one_is_refused(write, alpha, name):
    plane = np.ones_like(PLANE)
    plane[2, 3] = alpha
    assert refused(write("a.exr", {**COLOUR, name: plane})).startswith("has an alpha below 1: put ")
    assert (files.load(write("b.exr", {**COLOUR, name: np.ones_like(PLANE)})).rgb[:, :, 0] == PLANE).all()


def test_other_primaries_are_refused(write):
    aces = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    assert refused(write("a.exr", COLOUR, chromaticities=aces)).startswith("its primaries are not those of sRGB")
    same = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    assert (files.load(write("b.exr", COLOUR, chromaticities=same)).rgb[:, :, 0] == PLANE).all()


def test_whole_numbers_are_no_colour(write):
    whole = {name: np.ones((5, 6), np.uint32) for name in "RGB"}
    assert refused(write("a.exr", whole)) == "rgb: expected channels of type HALF or FLOAT"
    assert (
        refused(write("b.exr", {**COLOUR, "depth.Z": whole["R"]})) == "depth: expected channels of type HALF or FLOAT"
    )
    assert refused(write("c.exr", {**COLOUR, "prim_id.id": PLANE})) == "prim_id: expected channels of type UINT"


def test_coarser_channels_are_refused(write):
    channels = {name: OpenEXR.Channel(name, np.ones((2, 3), np.float32), 2, 2) for name in "RGB"}
    header = {"dataWindow": window(0, 0, 6, 4), "displayWindow": window(0, 0, 6, 4)}
    assert refused(write("a.exr", channels, **header)).startswith("subsampled channels")


def test_one_part_with_colour_is_read_and_two_are_refused(tmp_path):
    def write(name, *parts):
        made = [OpenEXR.Part({**BASE, "name": f"p{k}"}, dict(part)) for k, part in enumerate(parts)]
        with OpenEXR.File(made) as file:
            file.write(str(tmp_path / name))
        return tmp_path / name

    depth, colour = {"depth.Z": PLANE.copy()}, {name: plane.copy() for name, plane in COLOUR.items()}
    assert (files.load(write("a.exr", depth, colour)).rgb[:, :, 0] == PLANE).all()
    other = {name: plane.copy() for name, plane in COLOUR.items()}
    assert refused(write("b.exr", colour, other)) == "2 parts with channels R, G and B; save one of them"


@pytest.mark.parametrize("text", ["four", "[" * 5000, "9" * 5000])
def test_an_attribute_that_is_no_json_is_refused(write, text):
    path = write("a.exr", COLOUR, **{"raytrace:exposure": text})
    assert refused(path) == "its text raytrace:exposure is not valid JSON; remove it"


def test_attributes_of_other_types_and_names_are_none_of_ours(write):
    path = write(
        "a.exr", COLOUR, **{"raytrace:seed": 7, "raytrace:v": corner(1, 2), "owner": "me", "raytrace:spp": "4"}
    )
    assert files.load(path).provenance == {"spp": 4}


@pytest.mark.parametrize(
    "compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"]
)  # all that OpenEXR has
def test_every_compression_is_read(write, compression):
    path = write("a.exr", COLOUR, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    assert compare(files.load(path).rgb, np.stack(list(COLOUR.values()), axis=2)).rmse < 0.01


def test_the_type_of_an_attribute_may_lie(write):
    whole = write("a.exr", COLOUR).read_bytes()
    for name, before, after in (
        (b"dataWindow\0", b"box2i\0", b"boxes\0"),
        (b"displayWindow\0", b"box2i\0", b"boxes\0"),
        (b"channels\0", b"chlist\0", b"chlost\0"),
    ):
        at = whole.index(name) + len(name)
        assert whole[at:].startswith(before)
        path = write("b.exr", COLOUR)
        path.write_bytes(whole[:at] + after + whole[at + len(after) :])
        assert refused(path)
