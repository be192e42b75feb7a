"""``BVH`` against the twin that tries every triangle, and all that its door promises."""

import copy
import multiprocessing
import os
import pickle
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest

import naive
import rays
import raytrace as rt

pytestmark = pytest.mark.engine

TESTS = Path(__file__).parent
PRECISIONS = ("float32", "float64")
FLOOR = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])  # z = 0
MESHES = {
    "soup": lambda: rays.soup(200, seed=1),
    "slivers": lambda: rays.soup(200, seed=2, size=2.0),
    "grid": lambda: (rays.grid(8)[0] / 4 - 1, rays.grid(8)[1]),
    "torus": lambda: rays.torus(16, 8),
}


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", MESHES)
def test_closest_hit_is_the_twins(name, precision, split):
    vertices, faces = MESHES[name]()
    vertices, o, d = rays.rounded(precision, vertices, *rays.anywhere(2000, seed=3))
    hits = rt.BVH(vertices, faces, precision, split).closest_hit(o, d)
    expected = naive.closest_hit(vertices, faces, o, d)
    eps = np.finfo(precision).eps
    weight, cosine, _ = rays.condition((vertices, faces), o, d)
    # sheared vertices are off by eps of at most |v - o| < 16, their areas by that times the height seen by the ray
    clear = (weight * cosine > 1e4 * eps).all(axis=1)
    assert clear.mean() > 0.1
    assert np.mean(expected.prim_id[clear] >= 0) > 0.05
    same = hits.prim_id == expected.prim_id
    # one of two triangles at nearly the same place is as good as the other
    crossing = np.isfinite(hits.t) & np.isclose(hits.t, expected.t, rtol=100 * eps, atol=0)
    assert (same | crossing)[clear].all()
    found = clear & same & (hits.prim_id >= 0)
    steep = cosine[found, hits.prim_id[found]] * np.linalg.norm(d[found], axis=1)
    np.testing.assert_array_less(np.abs(hits.t[found] - expected.t[found]), 32 * eps / steep)
    for got, twin in ((hits.u, expected.u), (hits.v, expected.v)):
        np.testing.assert_allclose(got[found], twin[found], atol=1e-3 if precision == "float32" else 1e-11)


@pytest.mark.parametrize("triangle", ["watertight", "moller-trumbore"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_any_hit_is_a_closest_hit_within_the_same_interval(precision, triangle):
    bvh = rt.BVH(*rays.soup(300, seed=5), precision, triangle=triangle)
    o, d = (a.astype(precision) for a in rays.anywhere(4000, seed=6))
    t = bvh.closest_hit(o, d).t
    some = np.where(np.isfinite(t), t, 1)
    rng = np.random.default_rng(7)
    ends = [0 * some, some, np.nextafter(some, 0), np.nextafter(some, 9), some * rng.uniform(0, 2, some.shape), -some]
    for tmin in ends:
        for tmax in [*ends, np.full_like(some, np.inf)]:
            tmin, tmax = tmin.astype(precision), tmax.astype(precision)
            hits = bvh.closest_hit(o, d, tmin, tmax)
            assert np.array_equal(bvh.any_hit(o, d, tmin, tmax), hits.prim_id >= 0)
            assert np.array_equal(np.isfinite(hits.t), hits.prim_id >= 0)
            found = hits.prim_id >= 0
            assert ((tmin < hits.t) & (hits.t < tmax))[found].all()


# --- ties ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_of_ten_thousand_equal_triangles_the_first_is_hit(precision, split):
    vertices, faces = FLOOR
    far = np.concatenate([vertices + [0, 0, -1], vertices])
    bvh = rt.BVH(far, np.concatenate([[[0, 1, 2]] * 7, np.repeat(faces + 3, 10_000, axis=0)]), precision, split)
    o, d = np.random.default_rng(8).uniform(0.1, 1.0, (64, 3)), [0.0, 0.0, -1.0]
    for hits in rays.all_paths(bvh, o.astype(precision), np.tile(d, (64, 1)).astype(precision)):
        assert (hits.prim_id == 7).all()


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_of_overlapping_triangles_in_a_plane_the_first_is_hit(precision, split):
    rng = np.random.default_rng(9)
    corners = rng.integers(-8, 9, (400, 3, 3)).astype(np.float64)
    corners[..., 2] = rng.choice([0.0, 0.0, -1.0], (400, 1))
    vertices, faces = corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)
    o = np.column_stack([rng.integers(-9, 10, (1000, 2)), np.full(1000, 2.0)])
    d = np.tile([0.0, 0.0, -1.0], (1000, 1))  # straight down: t is exactly 2 or 3
    expected = naive.closest_hit(vertices, faces, o, d)
    assert len(np.unique(expected.prim_id)) > 20
    bvh = rt.BVH(vertices, faces, precision, split)
    for hits in rays.all_paths(bvh, o.astype(precision), d.astype(precision)):
        assert np.array_equal(hits.prim_id, expected.prim_id)
        assert np.array_equal(hits.t, expected.t)


# --- one answer ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", PRECISIONS)
def test_answers_do_not_depend_on_batch_tree_or_threads(precision):
    mesh = rays.torus(30, 15)
    bvh = rt.BVH(*mesh, precision)
    o, d = (a.astype(precision) for a in rays.anywhere(1000, seed=10))
    hits, blocked = bvh.closest_hit(o, d), bvh.any_hit(o, d)
    assert 0.1 < blocked.mean() < 0.9
    order = np.random.default_rng(11).permutation(1000)
    assert rays.same_hits(rays.scattered(bvh.closest_hit(o[order], d[order]), order, 1000), hits)
    assert rays.same_hits(rt.BVH(*mesh, precision, "median").closest_hit(o, d), hits)
    for i in range(0, 1000, 9):
        assert rays.same_hits(bvh.closest_hit(o[i], d[i]), rt.Hits(*(column[i : i + 1] for column in hits)))
        assert bvh.any_hit(o[i], d[i])[0] == blocked[i]
    many = 40  # batches that are dealt to threads
    for threads in (1, 2, 5):
        more = bvh.closest_hit(np.tile(o, (many, 1)), np.tile(d, (many, 1)), threads=threads)
        assert rays.same_hits(more, rt.Hits(*(np.tile(column, many) for column in hits)))
        assert np.array_equal(
            bvh.any_hit(np.tile(o, (many, 1)), np.tile(d, (many, 1)), threads=threads), np.tile(blocked, many)
        )


@pytest.mark.parametrize("precision", PRECISIONS)
def test_distances_count_directions_of_any_length(precision):
    bvh = rt.BVH(*rays.torus(30, 15), precision)
    o, d = (a.astype(precision) for a in rays.anywhere(1000, seed=12))
    hits = bvh.closest_hit(o, d)
    found = hits.prim_id >= 0
    assert 0.1 < found.mean() < 0.9
    for power in (-70, -66, -30, -1, 1, 30, 66):
        scale = np.array(2.0**power, precision)
        scaled = bvh.closest_hit(o, d * scale)
        assert rays.same_hits(scaled, hits._replace(t=hits.t / scale))
        assert np.array_equal(bvh.any_hit(o, d * scale, tmax=2 / scale), bvh.any_hit(o, d, tmax=2))
    for length in (1e-20, 1e-7, 0.3, 1e20):
        scaled = bvh.closest_hit(o, d * np.array(length, precision))
        same = scaled.prim_id == hits.prim_id
        assert same.mean() > 0.99  # directions are rounded, so a ray at an edge may change sides
        # a rounding of d moves the hit by eps / cosine: grazing rays are few
        ratio = scaled.t[found & same] * length / hits.t[found & same]
        np.testing.assert_allclose(np.quantile(np.abs(ratio - 1), 0.9), 0, atol=20 * np.finfo(precision).eps)


def test_the_shortest_directions_still_hit():
    bvh = rt.BVH(*FLOOR)
    d = np.array([[0, 0, -1e-44], [0, 0, -1e-40], [0, 0, -1e-38]], np.float32)  # the first two are denormal
    o = np.array([1, 1, 1e-10], np.float32)
    np.testing.assert_allclose(bvh.closest_hit(o, d).t, o[2] / -d[:, 2].astype(np.float64), rtol=1e-6)
    double = rt.BVH(*FLOOR, "float64").closest_hit([1, 1, 1e-10], [[0, 0, -1e-310]])
    np.testing.assert_allclose(double.t, 1e300, rtol=1e-12)


# --- intervals and bad rays ------------------------------------------------------------------------------------------


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy tells of the 1 / 0 that kernels are meant to compute
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_interval_is_open(precision):
    bvh = rt.BVH(*FLOOR, precision)
    ray = [1, 1, 3], [0, 0, -4]  # meets the floor at exactly 0.75
    below, above = (float(np.nextafter(np.array(0.75, precision), end, dtype=precision)) for end in (0, 1))
    intervals = [(0.75, 9), (0, 0.75), (below, above), (below, 0.75), (0.75, above), (0.9, 0.6), (0.75, 0.75)]
    intervals += [(-np.inf, np.inf), (-5, 0), (0.76, np.inf), (np.nan, 9), (0, np.nan), (np.inf, -np.inf)]
    expected = [a < 0.75 < b for a, b in intervals]
    assert sum(expected) == 2
    tmin, tmax = np.array(intervals).T
    hits = bvh.closest_hit(*ray, tmin, tmax)
    assert hits.t.tolist() == [0.75 if hit else np.inf for hit in expected]
    assert bvh.any_hit(*ray, tmin, tmax).tolist() == expected


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_negative_tmin_finds_what_lies_behind(precision):
    bvh = rt.BVH(*FLOOR, precision)
    up = [1, 1, 3], [0, 0, 4]
    assert bvh.closest_hit(*up).prim_id[0] == -1
    assert bvh.closest_hit(*up, tmin=-1).t[0] == -0.75
    assert bvh.closest_hit(*up, tmin=-1, tmax=-0.5).t[0] == -0.75
    assert not bvh.any_hit(*up, tmin=-0.75)[0]


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_that_are_not_finite_or_have_no_direction_miss(precision):
    bvh = rt.BVH(*FLOOR, precision)
    o, d = rays.bad_rays()
    assert bvh.any_hit([1, 1, 1], [-1, -1, -1], threads=1)[0]
    hits = bvh.closest_hit(o, d)
    assert (hits.prim_id == -1).all()
    assert (hits.t == np.inf).all()
    assert not bvh.any_hit(o, d).any()
    good = np.resize([False, True, True], len(o))  # beside good ones, they stay alone
    o[good], d[good] = (1, 1, 1), (0, 0, -1)
    assert np.array_equal(bvh.any_hit(o, d), good)
    assert np.array_equal(bvh.closest_hit(o, d).t, np.where(good, 1, np.inf))


def test_hits_may_lie_beyond_all_numbers_only_if_they_are_misses():
    bvh = rt.BVH(*FLOOR)
    o, d = np.array([[1, 1, 1]], np.float32), np.array([[0, 0, -1e-40]], np.float32)  # t = 1e40
    hits = bvh.closest_hit(o, d)
    assert np.array_equal(hits.prim_id >= 0, np.isfinite(hits.t))
    assert np.array_equal(bvh.any_hit(o, d), np.isfinite(hits.t))


@pytest.mark.parametrize(("precision", "height"), [("float32", 1e-40), ("float64", 1e-310)])
def test_meshes_of_all_but_no_height_are_split(precision, height):
    """Bins over such an extent are so narrow that their number is none."""
    vertices, faces = rays.soup(400, seed=17, size=0.1)
    vertices[:, 2] *= height
    bvh = rt.BVH(vertices, faces, precision)
    bvh.validate()
    assert bvh.stats.levels < 10
    middle = bvh.vertices[faces].mean(axis=1) * [1, 1, 0]
    assert bvh.any_hit(middle + [0, 0, 1], [0, 0, -1]).all()


# --- in the caller's hands -------------------------------------------------------------------------------------------

PROGRAM = """
import os, pickle, signal, sys, threading, time
import numpy as np
import rays
import raytrace as rt

bvh = rt.BVH(*rays.torus(30, 15))
o, d = (a.astype("f4") for a in rays.anywhere(200_000, seed=16))

def ask(threads=2):
    hits = bvh.closest_hit(o, d, threads=threads)
    return b"".join(column.tobytes() for column in hits) + bvh.any_hit(o, d, threads=threads).tobytes()

expected = ask()
"""


def python(program, **options):
    """Run a program that knows ``bvh``, rays, how to ``ask`` and what is ``expected``; what it prints."""
    command = [sys.executable, "-c", PROGRAM + textwrap.dedent(program)]
    paths = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=os.environ | {"PYTHONPATH": paths}, **options
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_threads_may_share_a_tree():
    bvh = rt.BVH(*rays.torus(30, 15))
    o, d = (a.astype("f4") for a in rays.anywhere(50_000, seed=14))
    expected, blocked = bvh.closest_hit(o, d), bvh.any_hit(o, d)
    wrong = []

    def ask(threads):
        for _ in range(3):
            same = rays.same_hits(bvh.closest_hit(o, d, threads=threads), expected)
            if not (same and np.array_equal(bvh.any_hit(o, d, threads=threads), blocked)):
                wrong.append(threads)

    callers = [threading.Thread(target=ask, args=(1 + k % 3,)) for k in range(6)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert not wrong


def test_small_batches_start_no_threads(monkeypatch):
    monkeypatch.setattr(threading.Thread, "start", None)
    bvh = rt.BVH(*FLOOR)
    assert bvh.closest_hit([1, 1, 1], np.tile([0.0, 0, -1], (1000, 1))).t.tolist() == [1.0] * 1000
    n = 300_000
    assert bvh.any_hit([1, 1, 1], np.tile([0.0, 0, -1], (n, 1)), threads=1).all()  # nor do large ones in one thread


@pytest.mark.parametrize("split", ["sah", "median"])
def test_a_tree_can_be_pickled(split):
    bvh = rt.BVH(*rays.torus(30, 15), "float64", split)
    o, d = rays.anywhere(500, seed=15)
    for other in (pickle.loads(pickle.dumps(bvh)), copy.copy(bvh), copy.deepcopy(bvh)):
        assert repr(other) == repr(bvh)
        assert rays.same_hits(other.closest_hit(o, d), bvh.closest_hit(o, d))
        other.validate()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_tree_works_after_a_fork_even_while_others_use_it():
    out = python("""
        busy = threading.Thread(target=lambda: [ask() for _ in range(3)])
        busy.start()
        for _ in range(3):
            child = os.fork()
            if child == 0:
                os._exit(0 if ask(1) == ask(2) == expected else 1)
            print(os.waitpid(child, 0)[1])
        busy.join()
        print(ask() == expected)
    """)
    assert out == ["0", "0", "0", "True"]


@pytest.mark.parametrize("method", sorted(set(multiprocessing.get_all_start_methods()) - {"forkserver"}))
def test_a_tree_goes_to_other_processes(method):
    bvh = rt.BVH(*rays.torus(30, 15))
    o, d = (a.astype("f4") for a in rays.anywhere(20_000, seed=16))
    with multiprocessing.get_context(method).Pool(2) as pool:
        for hits in pool.starmap(bvh.closest_hit, [(o, d, 0.0, np.inf, threads) for threads in (1, 2, 2)]):
            assert rays.same_hits(hits, bvh.closest_hit(o, d))


def test_a_tree_works_while_the_interpreter_ends():
    out = python("""
        import atexit
        atexit.register(lambda: print("atexit", ask() == expected, flush=True))
        class Last:
            def __del__(self, ask=ask, expected=expected):
                print("del", ask() == expected, flush=True)
        last = Last()
        threading.Thread(target=lambda: print("thread", ask() == expected, flush=True)).start()
    """)
    assert out == ["thread", "True", "atexit", "True", "del", "True"]
    assert python("""
        threading.Thread(target=lambda: [ask() for _ in range(999)], daemon=True).start()
        time.sleep(0.1)
        print("ends")
    """) == ["ends"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals to one process are not sent there")
@pytest.mark.parametrize(
    "call",
    ["bvh.closest_hit(o, d)", "bvh.any_hit(o, d, threads=1)", "bvh.all_hits(o, d)", "rt.BVH(*rays.torus(600, 300))"],
)
def test_an_interrupt_ends_calls_soon(call):
    """Measured on two busy cores: at most 0.1 s for queries, 0.4 s for a build of 10^7 triangles."""
    seconds, same = python(f"""
        o, d = np.tile(o, (10, 1)), np.tile(d, (10, 1))
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have left it ignored
        call = lambda: {call}
        call()
        timer = threading.Timer(0.2, lambda: (sent.append(time.perf_counter()), os.kill(os.getpid(), signal.SIGINT)))
        sent = []
        timer.start()
        try:
            while True:
                call()
        except KeyboardInterrupt:
            print(time.perf_counter() - sent[0])
        o, d = o[:200_000], d[:200_000]
        print(ask() == expected)
    """)
    assert float(seconds) < 60  # on a machine that has much else to do
    assert same == "True"


@pytest.mark.parametrize(("precision", "far"), [("float32", 1e9), ("float64", 1e30)])
def test_rays_of_any_size_end(precision, far):
    """In a process of its own: where quotients overflow, absent children were once visited for ever."""
    out = python(f"""
        bvh = rt.BVH(*rays.torus(30, 15), "{precision}")
        rng = np.random.default_rng(13)
        kind = np.finfo(bvh.precision)
        least, most = (np.log2(float(size)) for size in (kind.smallest_subnormal, kind.max))
        o, d = (rng.choice([-1, 0, 1], (20000, 3)) * 2 ** rng.uniform(least, most, (20000, 3)) for _ in range(2))
        aimed = rng.random(20000) < 0.5
        d[aimed] = np.where(np.abs(o) < {far}, rng.uniform(-1, 1, (20000, 3)) - o, d)[aimed]
        for o in (o, np.where(np.abs(o) < {far}, o, 0)):
            o, d = o.astype(bvh.precision), d.astype(bvh.precision)
            hits = bvh.closest_hit(o, d)
            print(np.array_equal(np.isfinite(hits.t), hits.prim_id >= 0))
        order = rng.permutation(20000)
        print(rays.same_hits(rays.scattered(bvh.closest_hit(o[order], d[order]), order, 20000), hits))
        print(np.array_equal(bvh.any_hit(o, d), hits.prim_id >= 0), 0.2 < (hits.prim_id >= 0).mean() < 0.8)
    """)
    assert out == ["True"] * 5
