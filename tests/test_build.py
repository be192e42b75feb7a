"""Trees: every triangle in one leaf, every box around what it holds, no matter how nasty the mesh."""

import numpy as np
import pytest

import exact
import rays
import raytrace as rt
from raytrace.accel import build as building
from raytrace.accel.build import build
from raytrace.accel.lanes import NODE
from raytrace.accel.layout import boxes_of, children_of

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
SPLITS = ("sah", "median")


def flaws(tree, triangles):
    """What is wrong with a tree over triangles (m, 12), a line each; a healthy tree has none."""
    child = tree.nodes.child.reshape(-1, 64)[:, 48:56]
    box = tree.nodes.bounds.reshape(-1, 64)[:, :48].reshape(-1, 2, 3, NODE)
    prim_id = tree.leaves.prim_id.reshape(-1, 104)[:, 72:80]
    rows = np.delete(tree.leaves.rows.reshape(-1, 13, NODE), 9, axis=1)
    found = []
    area = np.isfinite(triangles[:, 9:]).all(axis=1)
    counts = np.zeros(len(triangles), int)
    nodes_seen, leaves_seen = np.zeros(len(child), int), np.zeros(len(prim_id), int)

    def visit(node):
        """Bounds of all below a node."""
        nodes_seen[node] += 1
        if nodes_seen[node] > 1:
            found.append(f"node {node} has two parents")
            return np.array([np.full(3, np.inf), np.full(3, -np.inf)])
        used = np.count_nonzero(child[node])
        if not child[node, :used].all():
            found.append(f"node {node}: a gap between its children")
        if used == 0:
            found.append(f"node {node} is empty")
        whole = np.array([np.full(3, np.inf), np.full(3, -np.inf)])
        for k in np.flatnonzero(child[node]):
            inside = visit(child[node, k]) if child[node, k] > 0 else leaf(~child[node, k])
            if (inside[0] < box[node, 0, :, k]).any() or (inside[1] > box[node, 1, :, k]).any():
                found.append(f"node {node}: child {k} sticks out of its box")
            whole = np.array([np.minimum(whole[0], inside[0]), np.maximum(whole[1], inside[1])])
        if not ((box[node, 0, :, used:] == np.inf).all() and (box[node, 1, :, used:] == -np.inf).all()):
            found.append(f"node {node}: a child that is none can be entered")
        return whole

    def leaf(number):
        leaves_seen[number] += 1
        used = np.count_nonzero(prim_id[number] >= 0)
        mine = prim_id[number, :used]
        if not area.any():
            return np.array([np.full(3, np.inf), np.full(3, -np.inf)])  # one leaf of nothing
        if used == 0 or (mine < 0).any() or (prim_id[number, used:] != -1).any():
            found.append(f"leaf {number} is empty, or has a gap")
            return np.array([np.full(3, np.inf), np.full(3, -np.inf)])
        counts[mine] += 1
        if not np.array_equal(rows[number, :, :used].T, triangles[mine]):
            found.append(f"leaf {number}: rows that are not its triangles'")
        if rows[number, :, used:].any():
            found.append(f"leaf {number}: a triangle that is none has an area")
        corners = triangles[mine, :9].reshape(-1, 3)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    visit(0)
    found += [f"triangle {i} is in {counts[i]} leaves" for i in np.flatnonzero(counts != area)]
    found += [f"node {i} is never reached" for i in np.flatnonzero(nodes_seen == 0)]
    found += [f"leaf {i} is in {leaves_seen[i]} nodes" for i in np.flatnonzero(leaves_seen != 1)]
    return found


def depth(child, node=0):
    return 1 + max((depth(child, k) for k in child[node] if k > 0), default=0)


def same_centroid(n):
    """Triangles of all sizes about one point."""
    corners = np.random.default_rng(1).normal(size=(n, 2, 3)) * np.geomspace(1e-3, 1e3, n)[:, None, None]
    corners = np.concatenate([corners, -corners.sum(axis=1, keepdims=True)], axis=1)
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3)


def spaced_exponentially(n):
    """Each triangle is half as far away as the one before it."""
    corner = np.array([[0, 0, 0], [1, 0, 0.25], [0, 1, 0]]) * 0.25 + 1
    corners = corner * 2.0 ** -np.arange(n)[:, None, None]
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3)


def with_flat_ones():
    """Every third triangle has no area."""
    vertices, faces = rays.torus(20, 10)
    faces[::3, 2] = faces[::3, 0]
    return vertices, faces


MESHES = {
    "one": lambda: (np.eye(3), np.array([[0, 1, 2]])),
    "eight": lambda: rays.soup(8, seed=2),
    "nine": lambda: rays.soup(9, seed=3),
    "soup": lambda: rays.soup(3000, seed=4),
    "grid": lambda: rays.grid(30),
    "torus": lambda: rays.torus(40, 20),
    "fan": lambda: rays.fan(1000),
    "equal": lambda: (np.eye(3), np.tile([0, 1, 2], (2000, 1))),
    "same centroid": lambda: same_centroid(1000),
    "spaced exponentially": lambda: spaced_exponentially(100),
    "with flat ones": with_flat_ones,
    "only flat ones": lambda: (np.eye(3), np.zeros((20, 3), int)),
    "nothing": lambda: (np.empty((0, 3)), np.empty((0, 3), int)),
}


def grown(name, precision="float32", split="sah", triangle="watertight"):
    vertices, faces = MESHES[name]()
    return build(vertices.astype(precision), faces.astype(np.int32), split, triangle)


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", MESHES)
def test_trees_are_healthy(name, precision, split):
    tree, triangles, levels, _ = grown(name, precision, split)
    assert flaws(tree, triangles) == []
    assert tree.nodes.bounds.dtype == tree.leaves.rows.dtype == precision
    assert depth(children_of(tree.nodes)) <= levels


@pytest.mark.parametrize("triangle", ["watertight", "moller-trumbore"])
@pytest.mark.parametrize("split", SPLITS)
def test_equal_meshes_give_equal_trees(split, triangle):
    (a, _, _, _), (b, _, _, _) = (grown("soup", "float32", split, triangle) for _ in range(2))
    for x, y in zip((*a.nodes, *a.leaves), (*b.nodes, *b.leaves), strict=True):
        assert rays.same_bits(x, y)


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", MESHES)
def test_interpreted_and_compiled_trees_are_the_same(name, precision, split, monkeypatch):
    """Small trees are built in the interpreter, large ones by kernels: no ray can tell."""
    vertices, faces = MESHES[name]()
    trees = []
    for few in (-1, 10**9):
        monkeypatch.setattr("raytrace.accel.build.SMALL_MESH", few)
        trees.append(build(vertices.astype(precision), faces[:300].astype(np.int32), split, "watertight"))
    for a, b in zip(*((*tree.nodes, *tree.leaves, triangles) for tree, triangles, _, _ in trees), strict=True):
        assert rays.same_bits(a, b)


@pytest.mark.parametrize("triangle", ["watertight", "moller-trumbore"])
def test_the_triangle_test_does_not_change_the_tree(triangle):
    a, b = grown("torus")[0], grown("torus", triangle=triangle)[0]
    assert np.array_equal(a.nodes.child, b.nodes.child)
    assert np.array_equal(a.leaves.prim_id, b.leaves.prim_id)


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", [name for name in MESHES if len(MESHES[name]()[1]) > 8])
def test_trees_stay_shallow(name, precision, split):
    count = len(MESHES[name]()[1])
    child = children_of(grown(name, precision, split)[0].nodes)
    # A node of eight holds at least one level of the binary tree, whose halves by count have log2(n / 8) levels;
    # the SAH may peel off eight a node for 64 levels before it must halve too.
    most = 2 + int(np.log2(count / NODE + 1))
    assert depth(child) <= most + (0 if split == "median" else 64)
    if name not in ("same centroid", "spaced exponentially"):
        assert depth(child) <= most


@pytest.mark.parametrize("split", SPLITS)
def test_a_long_geometric_row_ends_at_the_greatest_depth(split):
    """The SAH splits off few at a time here; numbers of this size would make a list of 900 levels."""
    vertices, faces = spaced_exponentially(900)
    tree, triangles, levels, _ = build(vertices, faces.astype(np.int32), split, "watertight")
    assert flaws(tree, triangles) == []
    assert levels < 75
    hits = rt.BVH(vertices, faces, "float64", split).closest_hit(vertices[faces].mean(axis=1) * [1, 1, 0.5], [0, 0, 1])
    # Seen along z, twice the area of triangle k is 2^(-4 - 2 k): a normal number up to k = 509, and beyond it a miss.
    assert np.array_equal(hits.prim_id, np.where(np.arange(900) < 510, np.arange(900), -1))


def test_the_sah_costs_less_than_halves():
    """What the SAH is for: a small thing in a large room. Cost: the sum of all boxes' areas."""
    vertices, faces = rays.torus(40, 20)
    room = [[-9, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]]
    vertices = np.concatenate([0.05 * vertices + [3, 0, 0], room])
    faces = np.concatenate([faces, [[800, 801, 802], [800, 802, 803]]]).astype(np.int32)
    cost = {}
    for split in SPLITS:
        nodes = build(vertices, faces, split, "watertight")[0].nodes
        box = boxes_of(nodes).reshape(-1, 2, 3, NODE).swapaxes(2, 3)
        x, y, z = np.moveaxis((box[:, 1] - box[:, 0])[children_of(nodes) != 0], 1, 0)
        cost[split] = np.sum(x * y + y * z + z * x)
    assert cost["sah"] < 0.6 * cost["median"]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_normals_are_unit_and_exact_to_rounding_even_of_needles(precision):
    vertices, faces = rays.soup(500, seed=5, size=1.0)
    vertices[2::3] = (vertices[0::3] + vertices[1::3]) / 2 + 1e-5 * np.random.default_rng(6).normal(size=(500, 3))
    vertices = vertices.astype(precision)
    _, triangles, _, _ = build(vertices, faces.astype(np.int32), "sah", "watertight")
    corners = vertices[faces].astype(np.longdouble)
    expected = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    expected /= np.sqrt((expected * expected).sum(axis=1, keepdims=True))
    eps = np.finfo(precision).eps
    # in float64, v1 - v0 is rounded: eps / 2 of an edge of length 1, over a height of 1e-5
    np.testing.assert_allclose(
        triangles[:, 9:], expected.astype(precision), atol=eps if precision == "float32" else 1e6 * eps
    )


def test_normals_in_double_lose_nothing_where_edges_are_nearly_parallel():
    """The first corner is 0, so edges are exact; differences of their products cancel all but a few digits."""
    rng = np.random.default_rng(7)
    a = rng.normal(size=(300, 3))
    b = 0.5 * a + 10.0 ** rng.uniform(-12, -6, (300, 1)) * rng.normal(size=(300, 3))
    a[0], b[0] = (1 + 2.0**-52, 1, 0), (1, 1 - 2.0**-52, 0)  # both products are rounded to 1
    vertices = np.stack([0 * a, a, b], axis=1).reshape(-1, 3)
    _, triangles, _, _ = build(vertices, np.arange(900, dtype=np.int32).reshape(-1, 3), "sah", "watertight")
    for i in range(300):
        n = exact.cross(exact.exact(a[i]), exact.exact(b[i]))
        largest = max(abs(x) for x in n)
        n = np.array([float(x / largest) for x in n])
        np.testing.assert_allclose(triangles[i, 9:], n / np.linalg.norm(n), rtol=0, atol=4 * np.finfo(np.float64).eps)


def children(a):
    """Where the children of nodes stand."""
    return np.flatnonzero((np.arange(len(a)) % 64 // 8 == 6) & (a != 0))


def inner(a):
    return children(a)[a[children(a)] > 0]


def leaf(a):
    return children(a)[a[children(a)] < 0]


def planted():
    """Ways to break a tree, and what the validator must say."""
    yield "nodes", "child", lambda a: a.__setitem__(inner(a)[0], 0), "gap|never reached"
    yield "nodes", "child", lambda a: a.__setitem__(inner(a)[1], a[inner(a)[0]]), "two parents"
    yield "nodes", "child", lambda a: a.__setitem__(leaf(a)[0], a[leaf(a)[1]]), "is in 2"
    yield "nodes", "bounds", lambda a: a.__setitem__(0, a[0] + 0.5), "sticks out"
    yield "nodes", "bounds", lambda a: a.__setitem__(24, a[24] - 0.5), "sticks out"
    yield "nodes", "bounds", lambda a: a.__setitem__(np.flatnonzero(a == np.inf)[0], 0), "can be entered"
    yield "leaves", "prim_id", lambda a: a.__setitem__(72, -1), "gap"
    yield "leaves", "prim_id", lambda a: a.__setitem__(72, a[104 + 72]), "is in 2 leaves"
    yield "leaves", "rows", lambda a: a.__setitem__(0, a[0] + 1e-3), "not its triangles"


@pytest.mark.parametrize("case", range(9))
def test_the_validator_sees_what_is_broken(case):
    tree, triangles, _, _ = grown("soup")
    part, field, damage, message = list(planted())[case]
    record = getattr(tree, part)
    changed = getattr(record, field).copy()
    damage(changed)
    broken = tree._replace(**{part: record._replace(**{field: changed})})
    assert flaws(tree, triangles) == []
    assert any(word in flaw for flaw in flaws(broken, triangles) for word in message.split("|"))


@pytest.mark.parametrize("name", ["with flat ones", "torus", "soup"])
def test_the_tree_does_not_depend_on_how_triangles_are_shared_out_to_be_measured(name, monkeypatch):
    whole, triangles, levels, _ = grown(name)
    monkeypatch.setattr(building, "STRETCH", 7)
    parts, same, depth, _ = grown(name)
    assert levels == depth
    assert rays.same_bits(triangles, same)
    assert rays.same_bits(whole.nodes.bounds, parts.nodes.bounds)
    assert rays.same_bits(whole.leaves.rows, parts.leaves.rows)
