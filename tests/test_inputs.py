"""The door of ``BVH``: numbers in any memory give the same bits, what is wrong is named, nothing is copied whole."""

import tracemalloc
import weakref
from itertools import cycle

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace import parallel
from raytrace.accel import inputs, ray_queries
from raytrace.records import Columns

PRECISIONS = ("float32", "float64")
FLOOR = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])  # z = 0
RAY = np.array([[1.0, 1, 1]]), np.array([[0.0, 0, -1]])  # hits it


def packed(a, field):
    """Rows of records that begin with one byte."""
    record = np.zeros(len(a), [("flag", "i1"), (field, a.dtype, a.shape[1:])])
    record[field] = a
    return record[field]


def aligned(a):
    """Rows of records that end with one more number."""
    record = np.zeros(len(a), [("a", a.dtype, a.shape[1:]), ("b", a.dtype)])
    record["a"] = a
    return record["a"]


def unaligned(a):
    memory = np.zeros(a.nbytes + 1, np.uint8)
    moved = memory[1:].view(a.dtype).reshape(a.shape)
    moved[:] = a
    return moved


def locked(a):
    a = a.copy()
    a.flags.writeable = False
    return a


LAYOUTS = {
    "list": lambda a: a.tolist(),
    "columns first": np.asfortranarray,
    "every second row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "every second column": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "columns first, every second row": lambda a: np.asfortranarray(np.repeat(a, 2, axis=0))[::2],
    "columns of a wider array": lambda a: np.concatenate([a, a], axis=1)[:, 3:],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "backwards in both": lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
    "read-only": locked,
    "read-only, columns first": lambda a: locked(np.asfortranarray(a)).T.T,
    "packed record": lambda a: packed(a, "a"),
    "aligned record": aligned,
    "unaligned": unaligned,
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "nothing masked": np.ma.asarray,
    "a class of its own": lambda a: a.view(type("Points", (np.ndarray,), {})),
}


@pytest.mark.parametrize("reach", [inputs.REACH, 100])  # 100: all large arrays are converted part by part
@pytest.mark.parametrize("precision", PRECISIONS)
def test_memory_layout_changes_nothing(precision, reach, monkeypatch):
    monkeypatch.setattr(inputs, "REACH", reach)
    vertices, faces = rays.torus(12, 6)
    vertices = vertices.astype(precision)
    o, d = (a.astype(precision) for a in rays.anywhere(203, seed=13))
    o *= 0.5
    tmax = np.linspace(1, 3, 203).astype(precision)
    bvh = rt.BVH(vertices, faces, precision)
    hits, blocked = bvh.closest_hit(o, d, tmax=tmax), bvh.any_hit(o, d, tmax=tmax)
    assert 0.1 < blocked.mean() < 0.9
    limits = cycle([tmax.tolist(), np.repeat(tmax, 3)[::3], tmax[::-1].copy()[::-1], packed(tmax, "t"), locked(tmax)])
    for (name, layout), t in zip(LAYOUTS.items(), limits, strict=False):
        assert rays.same_hits(bvh.closest_hit(layout(o), layout(d), tmax=t), hits), name
        assert rays.same_hits(bvh.closest_hit(layout(o), d, tmax=tmax), hits), name
        assert np.array_equal(bvh.any_hit(o, layout(d), tmax=t), blocked), name
        again = rt.BVH(layout(vertices), layout(faces), precision)
        assert rays.same_hits(again.closest_hit(o, d, tmax=tmax), hits), name


@pytest.mark.parametrize("precision", PRECISIONS)
def test_arrays_in_files_are_read_in_place(precision, tmp_path):
    bvh = rt.BVH(*rays.torus(12, 6), precision)
    o, d = (a.astype(precision) for a in rays.anywhere(203, seed=13))
    hits = bvh.closest_hit(o, d)
    for mode in ("r", "r+", "c"):
        (tmp_path / "rays").write_bytes(o.tobytes() + d.tobytes())
        file = np.memmap(tmp_path / "rays", precision, mode, shape=(2, 203, 3))
        assert rays.same_hits(bvh.closest_hit(file[0], file[1]), hits), mode
        del file


def test_arrays_that_all_rays_or_all_columns_share_take_no_memory():
    bvh = rt.BVH(*rays.soup(100, seed=14))
    o, d = (a.astype("f4") for a in rays.anywhere(300, seed=15))
    same = np.broadcast_to(o[7], (300, 3)), np.broadcast_to(d[:, :1], (300, 3)), np.broadcast_to(np.float32(2), 300)
    copies = [a.copy() for a in same]
    assert rays.same_hits(bvh.closest_hit(same[0], d, tmax=same[2]), bvh.closest_hit(copies[0], d, tmax=copies[2]))
    assert rays.same_hits(bvh.closest_hit(o, same[1]), bvh.closest_hit(o, copies[1]))


@pytest.mark.parametrize("layout", ["columns first", "every second row", "columns of a wider array", "read-only"])
def test_kernels_read_arrays_of_the_trees_type_in_place(layout):
    o = LAYOUTS[layout](rays.anywhere(50, seed=16)[0])
    fields, shape = inputs.check_rays(o, RAY[1], 0.0, np.inf, np.dtype("f8"))
    assert shape == (50,)
    assert all(isinstance(field, Columns) and field.data.flags.carray for field in fields)  # one type for kernels
    assert np.shares_memory(fields[0].data, o)
    for column in inputs.rays_of(fields, 20, 50, np.dtype("f8"))[:1]:
        read = column.data[column.start + column.row * np.arange(30)[:, None] + column.axis * np.arange(3)]
        assert np.array_equal(read, o[20:])


def test_memory_lives_as_long_as_kernels_may_read_it():
    o = LAYOUTS["every second row"](rays.anywhere(50, seed=16)[0])
    column, alive = inputs.columns_of(o, 50), weakref.ref(o)
    del o
    assert alive() is not None
    del column
    assert alive() is None


def test_elements_that_kernels_cannot_count_are_not_read_in_place():
    """Their numbers are int32, of whole elements where their type may lie."""
    apart = [np.lib.stride_tricks.as_strided(np.zeros(1), (3, 3), (step, 8)) for step in (2**33, -(2**33), 2**33 - 64)]
    assert [inputs._readable(array) for array in apart] == [False, False, True]
    assert [inputs._readable(LAYOUTS[name](np.zeros((5, 3)))) for name in ("unaligned", "packed record")] == [
        False,
        False,
    ]


@pytest.fixture
def small_parts(monkeypatch):
    """Threads that need little scratch memory, so that what is copied stands out."""
    for module in (ray_queries, parallel):
        monkeypatch.setattr(module, "MAX_RANGE", 1 << 13)


@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize("dtype", ["float32", "float64", "int64"])
def test_rays_of_another_type_are_converted_part_by_part(dtype):
    bvh = rt.BVH(*rays.torus(12, 6), "float32" if dtype != "float32" else "float64")
    rng = np.random.default_rng(17)
    n = 1_000_000
    o, d = (rng.integers(-9, 9, (n, 3)).astype(dtype) for _ in range(2))
    bvh.any_hit(o[:9000], d[:9000])  # compiled
    tracemalloc.start()
    try:
        answer = bvh.any_hit(o, d, threads=2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.001 < answer.mean() < 0.1
    assert np.array_equal(answer, bvh.any_hit(o.astype(bvh.precision), d.astype(bvh.precision)))
    assert peak < answer.nbytes + 6e6  # whole, o and d would be 24e6 or 48e6


@pytest.mark.usefixtures("small_parts")
def test_rays_of_the_trees_type_are_not_copied():
    bvh = rt.BVH(*rays.torus(12, 6))
    o, d = (a.astype("f4") for a in rays.anywhere(300_000, seed=18))
    bvh.closest_hit(o[:9000], d[:9000])
    for a, b in ((o, d), (np.asfortranarray(o), np.asfortranarray(d)), (locked(o), np.repeat(d, 2, axis=0)[::2])):
        tracemalloc.start()
        try:
            hits = bvh.closest_hit(a, b, threads=2)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < sum(column.nbytes for column in hits) + 2e6  # o alone is 3.6e6


# --- numbers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64", "longdouble", "int8", "uint16", "int64"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_numbers_of_every_type_are_taken(precision, dtype):
    vertices, faces = FLOOR
    o, d = np.array([[1, 1, 8], [3, 3, 8]]), np.array([[0, 0, 4], [0, 0, 2]])
    bvh = rt.BVH(vertices.astype(dtype), faces, precision)
    hits = bvh.closest_hit(o.astype(dtype), d.astype(dtype), tmin=np.array(-9, "i2"), tmax=np.array([0, 0], "f2"))
    assert hits.t.tolist() == [-2.0, np.inf]
    assert [column.dtype for column in hits] == [precision, "int32", precision, precision]


@pytest.mark.parametrize("kind", ["u1", "i2", ">i4", "u4", "i8", "u8"])
def test_faces_of_every_type_are_taken(kind):
    bvh = rt.BVH(FLOOR[0], FLOOR[1].astype(kind))
    assert bvh.closest_hit(*RAY).prim_id[0] == 0
    assert bvh.faces.dtype == np.int32


@pytest.mark.parametrize("kind", ["?", "c16", "O", "U3", "S3", "M8[s]", "m8[s]", "V8", [("x", "f4")]])
def test_what_is_not_a_number_is_refused_unless_it_is_empty(kind):
    bvh = rt.BVH(*FLOOR)
    wrong = np.zeros((3, 3), kind)
    for call, name in (
        (lambda a: rt.BVH(a, FLOOR[1]), "vertices"),
        (lambda a: rt.BVH(FLOOR[0], a), "faces"),
        (lambda a: bvh.closest_hit(a, RAY[1]), "origins"),
        (lambda a: bvh.any_hit(RAY[0], a), "directions"),
        (lambda a: bvh.closest_hit(*RAY, a[0]), "tmin"),
        (lambda a: bvh.any_hit(*RAY, 0, a[:1, 0]), "tmax"),
    ):
        with pytest.raises(ValueError, match=f"^{name}: expected (numbers|integers), got dtype"):
            call(wrong)
    nothing = np.zeros((0, 3), kind)
    assert len(bvh.closest_hit(nothing, nothing).t) == 0
    assert len(rt.BVH(nothing, nothing).faces) == 0


def test_masked_elements_are_refused():
    hidden = np.ma.masked_array(FLOOR[0], np.eye(3, dtype=bool))
    with pytest.raises(ValueError, match=r"vertices: .*masked"):
        rt.BVH(hidden, FLOOR[1])
    with pytest.raises(ValueError, match=r"directions: .*masked"):
        rt.BVH(*FLOOR).any_hit(RAY[0], np.ma.masked_values(RAY[1], -1.0))


@pytest.mark.parametrize("factor", [1.0, -1.0])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_sizes_whose_areas_are_not_numbers_are_refused(precision, factor):
    smallest, largest = inputs.safe_sizes(np.dtype(precision))
    triangle, ray = factor * FLOOR[0] / 4, (factor * RAY[0] / 4, RAY[1])
    for size in (smallest * 1.01, largest * 0.99):
        bvh = rt.BVH(triangle * size, FLOOR[1], precision)
        hits = bvh.closest_hit(ray[0] * size, factor * ray[1])
        np.testing.assert_allclose([hits.t[0] / size, hits.u[0], hits.v[0]], 0.25, rtol=1e-6)
    for size in (smallest * 0.98, largest * 1.02, largest**1.9, smallest**1.9):
        with pytest.raises(ValueError, match=r"vertices: the largest coordinate is .* must lie between .* other units"):
            rt.BVH(triangle * size, FLOOR[1], precision)
    rt.BVH(0 * triangle, FLOOR[1], precision)  # in one point: nothing that could be hit


def test_float32_meshes_out_of_range_name_the_cure():
    for size in (1e-20, 1e20):
        with pytest.raises(ValueError, match="precision='float64'"):
            rt.BVH(FLOOR[0] * size, FLOOR[1])
        assert rt.BVH(FLOOR[0] * size, FLOOR[1], "float64").any_hit(RAY[0] * size, RAY[1])[0]
    with pytest.raises(ValueError, match=r"row 1 is not finite in float32.*precision='float64'"):
        rt.BVH(FLOOR[0] * 1e39, FLOOR[1])
    with pytest.raises(ValueError, match=r"row 1 is not finite in float32: \[ *nan.*\(1 such rows\)$"):
        rt.BVH(FLOOR[0] + [[0], [np.nan], [0]], FLOOR[1])


@pytest.mark.parametrize("name", ["vertices", "faces"])
def test_meshes_with_more_rows_than_int32_can_number_are_refused(name):
    many = np.broadcast_to(np.zeros(3, "i1"), (2**29 + 1, 3))  # three bytes
    with pytest.raises(ValueError, match=f"^{name}: 536,870,913 rows are more than"):
        rt.BVH(**({"vertices": FLOOR[0], "faces": FLOOR[1]} | {name: many}))


# --- shapes ----------------------------------------------------------------------------------------------------------


def test_one_origin_one_direction_or_one_limit_are_shared():
    bvh = rt.BVH(*rays.soup(100, seed=14), "float64")
    o, d = rays.anywhere(50, seed=15)
    tmax = np.linspace(0.5, 3, 50)
    for origins, directions, limits in [
        (o[0], d, 2.0),
        (o[:1], d, [2.0]),
        (o, d[0], 2.0),
        (o, d[:1], tmax),
        (o[0], d[0], tmax),
    ]:
        full = (np.broadcast_to(origins, (50, 3)).copy(), np.broadcast_to(directions, (50, 3)).copy())
        expected = bvh.closest_hit(*full, tmax=np.broadcast_to(limits, 50).copy())
        assert rays.same_hits(bvh.closest_hit(origins, directions, tmax=limits), expected)
        assert np.array_equal(bvh.any_hit(origins, directions, tmax=limits), expected.prim_id >= 0)


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy tells of the 1 / 0 that kernels are meant to compute
@pytest.mark.parametrize("precision", PRECISIONS)
def test_nothing_is_a_batch_and_a_mesh_too(precision):
    nothing = np.empty((0, 3))
    for bvh in (
        rt.BVH(*FLOOR, precision),
        rt.BVH(nothing, [], precision),
        rt.BVH(FLOOR[0], nothing.astype(int), precision),
    ):
        assert [len(column) for column in bvh.closest_hit(nothing, nothing)] == [0] * 4
        assert bvh.any_hit(nothing, [0, 0, -1]).shape == (0,)
        assert bvh.surface(bvh.closest_hit([0, 0, 0], nothing)).p.shape == (0, 3)
        hits = bvh.closest_hit([[1, 1, 1]], [[0, 0, -1]])
        assert hits.t.shape == (1,)
        assert bvh.any_hit([1, 1, 1], [0, 0, -1])[0] == (hits.prim_id[0] == 0) == (len(bvh.faces) == 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((FLOOR[0], [[0, 1, 2], [0, 1, 3]]), "faces: row 1 .*3 vertices"),
        ((FLOOR[0], [[0, 1, -1]]), "faces: row 0"),
        ((FLOOR[0], np.array([[0, 1, 2], [0, 1, 2**32]])), "faces: row 1 .*4294967296.*3 vertices"),
        ((FLOOR[0], np.array([[0, -(2**32), 2]])), "faces: row 0 .*-4294967296"),
        ((FLOOR[0], np.array([[0, 1, 2**64 - 1]], "u8")), "faces: row 0 .*18446744073709551615"),
        ((FLOOR[0], [[0, 1, 2**64]]), "faces: .*integers"),
        ((np.zeros((0, 3)), [[0, 0, 0]]), "faces: row 0 .* 0 vertices"),
        ((FLOOR[0], [[0.0, 1.0, 2.0]]), "faces: .*integers"),
        ((FLOOR[0], [[True, False, True]]), "faces: .*integers"),
        ((FLOOR[0], [[0, 1, 2, 0]]), r"faces: .*\(1, 4\)"),
        ((FLOOR[0], [0, 1, 2]), r"faces: .*\(3,\)"),
        (([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]]), "vertices: row 2 is not finite"),
        (([[0, 0, 0], [1, 0, 0], [0, -np.inf, 0]], [[0, 1, 2]]), "vertices: row 2 is not finite"),
        (([[0, 0, 0], [1e39, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "vertices: row 1 is not finite in float32"),
        (([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), r"vertices: .*\(3, 2\)"),
        (([[0, 0, 0], [1, 0]], [[0, 1, 0]]), "vertices: "),
        (([["a", "b", "c"]] * 3, [[0, 1, 2]]), "vertices: .*numbers"),
        ((None, [[0, 1, 2]]), "vertices: .*numbers"),
        ((iter(FLOOR[0]), [[0, 1, 2]]), "vertices: .*numbers"),
        ((FLOOR[0], None), "faces: missing"),
        ((FLOOR[0], 7), r"faces: .*shape \(\)"),
        ((np.zeros((0, 4)), []), r"vertices: .*\(0, 4\)"),
        ((np.zeros((2, 3, 3)), [[0, 1, 2]]), r"vertices: .*\(2, 3, 3\)"),
        ((FLOOR[0] * 1j, [[0, 1, 2]]), "vertices: .*numbers"),
        ((*FLOOR, "float16"), "precision: .*float32, float64.*float16"),
        ((*FLOOR, "float32", "best"), "split: .*sah, median.*best"),
        ((*FLOOR, "float32", "sah", "plane"), "triangle: .*watertight, moller-trumbore.*plane"),
    ],
)
def test_a_mesh_that_is_wrong_is_told_where(arguments, message):
    with pytest.raises(ValueError, match=message):
        rt.BVH(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((3, 3)), np.zeros((2, 3))), r"origins \(3,\), directions \(2,\)"),
        ((np.zeros((3, 3)), np.zeros((0, 3))), "shapes do not match"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(2)), "tmin.*2"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, np.zeros(4)), "tmax.*4"),
        ((np.zeros((3, 4)), np.zeros((3, 3))), r"origins: .*\(3, 4\)"),
        ((np.zeros((3, 3)), np.zeros(4)), r"directions: .*\(4,\)"),
        ((np.zeros((3, 3)), 1.0), r"directions: .*\(\)"),
        ((np.zeros((3, 3)), np.zeros((2, 4, 3))), r"directions \(2, 4\)"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 2))), r"tmin \(3, 2\)"),
        (([[0, 0, 0], [0, 0]], np.zeros((2, 3))), "origins: "),
        (([["x", "y", "z"]], np.zeros((1, 3))), "origins: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)) * 1j), "directions: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)), "x"), "tmin: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)), 0.0, None), "tmax: "),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, 1.0, 0), "threads"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, 1.0, -1), "threads"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, 1.0, 1.5), "threads"),
        ((np.zeros((0, 3)), np.zeros((0, 3)), 0.0, 1.0, "2"), "threads"),
    ],
)
def test_rays_that_do_not_go_together_are_told_so(arguments, message):
    bvh = rt.BVH(*FLOOR)
    for query in (bvh.closest_hit, bvh.any_hit):
        with pytest.raises(ValueError, match=message):
            query(*arguments)
