"""How much of each bound of docs/numerics.md is needed: points that rays leave, lights on triangles, Snell's law."""

import sys
from collections.abc import Callable
from importlib import import_module
from itertools import product
from typing import Any

import mpmath
import numpy as np
from harness import ROOT, begin, finish, parser, show, table
from mpmath import mpf

import raytrace as rt
from raytrace.passes.light import SPAN

PRECISIONS = "float32", "float64"
ROUNDINGS = 3  # of gamma(3), in the bounds of points and lights
SHARES = np.arange(1, 13) / 12  # of gamma(3): a quarter of a rounding each
PLACES = (0.0, 1.0), (0.0, 1e-6), (0.0, 1e6), (1.0, 1e-3), (1e2, 1.0), (1e4, 1.0)  # shift and size, world units
STEEP = 1e-3  # shadow rays are judged if they are steeper to the plane,
INSIDE = 64  # and cross the triangle by so many roundings of the scene's size inside its edges
Vectors = np.ndarray  # (n, 3)
Law = Callable[..., tuple[Vectors, np.ndarray]]


def unit(a: Vectors) -> Vectors:
    """Vectors divided by their lengths."""
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def triangle(rng: np.random.Generator, shift: float, size: float) -> Vectors:
    """One triangle of any shape: ordinary, a sliver of 1e-6, in a plane of an axis, or in a plane near the origin."""
    corners = rng.normal(size=(3, 3))
    shape = rng.integers(4)
    if shape == 1:
        corners[2] = corners[0] + 1e-6 * (corners[2] - corners[0])
    elif shape == 2:
        corners[:, 1] = 0.3
    elif shape == 3:
        corners -= corners.mean(axis=0)
    return size * corners + shift * np.array([1.0, -0.7, 0.4])


# --- rays that leave a triangle ---------------------------------------------------------------------------------------


def weights(rng: np.random.Generator, n: int) -> Vectors:
    """Weights of n points: a third inside, a third on an edge, a third at a corner."""
    made = rng.dirichlet([1] * 3, n)
    made[n // 3 :, 0] = 0.0
    made[2 * n // 3 :, 1] = 0.0
    made = made / made.sum(axis=1, keepdims=True)
    return np.asarray(rng.permuted(made, axis=1))


def leaving(rng: np.random.Generator, corners: Vectors, precision: str, n: int) -> np.ndarray:
    """How many of n rays from points of a triangle meet it again, for each of ``SHARES`` of the bound."""
    bvh = rt.BVH(corners, [[0, 1, 2]], precision)
    share = weights(rng, n).astype(precision)
    zero = np.zeros(n, precision)
    p, p_error, ng = bvh.surface(rt.Hits(zero, np.zeros(n, np.int32), share[:, 1], share[:, 2]))
    side = np.where(rng.random((n, 1)) < 0.5, -1.0, 1.0) * ng.astype(np.float64)
    along = unit(rng.dirichlet([1] * 3, n) @ corners.astype(np.float64) - p + 1e-300)
    flat = np.where(rng.random((n, 1)) < 0.5, unit(np.cross(side, rng.normal(size=(n, 3)))), along)
    lift = np.finfo(precision).eps * 10.0 ** rng.uniform(0.31, 7, (n, 1))  # from 4u on
    d = np.where(rng.random((n, 1)) < 0.3, unit(rng.normal(size=(n, 3))), flat + lift * side)
    d = np.where((d * side).sum(axis=1, keepdims=True) < 0, -d, d).astype(precision)
    found = []
    for part in SHARES:
        o = rt.spawn_ray(p, part.astype(precision) * p_error, ng, side.astype(precision))
        found.append(np.count_nonzero(bvh.any_hit(o, d)))
    return np.array(found)


def points(precision: str, triangles: int, rays: int) -> dict[str, Any]:
    """The smallest part of the bound with which no ray meets what it leaves, in roundings of the 3."""
    rng, met = np.random.default_rng(1), np.zeros(len(SHARES), int)
    for k in range(triangles):
        corners = triangle(rng, *PLACES[k % len(PLACES)]).astype(precision)
        met += leaving(rng, corners, precision, rays)
    enough = SHARES[np.flatnonzero(met)[-1] + 1 :] if met.any() else SHARES
    needed = float(ROUNDINGS * enough[0]) if len(enough) else float("inf")
    return {"precision": precision, "rays": triangles * rays, "needed of 3": needed, "met with 3": int(met[-1])}


# --- lights on a triangle ---------------------------------------------------------------------------------------------


def exact_height(corners: Vectors, place: Vectors) -> mpf:
    """Distance of a place from the plane of a triangle, along its normal."""
    a, b, c, p = (mpmath.matrix([mpf(float(x)) for x in row]) for row in (*corners, place))
    e, f, q = b - a, c - a, p - a
    n = mpmath.matrix([e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]])
    return (n.T * q)[0] / mpmath.norm(n)


def room(corners: Vectors, o: Vectors, light: Vectors, height: float, normal: Vectors) -> Vectors:
    """How far inside the triangle's edges rays to a light at that height cross its plane, world units."""
    a, b, c = corners.astype(np.float64)
    from_plane = (o - a) @ normal
    end = (light - a) + (height / (from_plane - height))[:, None] * (light - o)
    v, w = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), end.T, rcond=None)[0]
    area = np.linalg.norm(np.cross(b - a, c - a))
    heights = [area / np.linalg.norm(side) for side in (c - b, a - c, b - a)]
    return np.min([part * up for part, up in zip((1 - v - w, v, w), heights, strict=True)], axis=0)


def light_beside(rng: np.random.Generator, precision: str, n: int) -> tuple[int, float, float]:
    """Rays judged, the largest part of the margin at which one errs, and the part stopped by a light's own plane."""
    eps = np.finfo(precision).eps
    normal = np.full(3, np.nan)
    while np.isnan(normal).any():  # rounded to no area
        corners = (triangle(rng, 0.0, 1.0) + rng.choice([0, 1, 30]) * rng.normal(size=3)).astype(precision)
        bvh = rt.BVH(corners, [[0, 1, 2]], precision)
        normal = bvh.triangles[0, 9:].astype(np.float64)
    low, high = corners.min(axis=0) - 5.0, corners.max(axis=0) + 5.0  # the scene
    reach = ROUNDINGS * eps / 2 * (2 * np.abs(corners).max(axis=0).astype(np.float64) + SPAN * (high - low))
    margin, middle = float(np.abs(normal) @ reach), corners.mean(axis=0, dtype=np.float64)
    o = rng.uniform(low, high, (n, 3)).astype(precision)
    judged, worst = 0, 0.0
    for part in rng.choice([-1, 1], 8) * 10.0 ** rng.uniform(-3, 0, 8):
        light = (middle + part * margin * normal).astype(precision)
        height = float(exact_height(corners, light))
        way = light.astype(np.float64) - o
        clear = np.abs(way @ normal) / np.linalg.norm(way, axis=1) > STEEP
        least = (
            INSIDE * eps / 2 * (np.abs(o).max() + np.abs(corners).max())
        )  # the test may miss what is nearer to an edge
        clear &= room(corners, o.astype(np.float64), light.astype(np.float64), height, normal) > least
        between = np.sign(height) != np.sign((o - middle) @ normal)
        wrong = clear & (bvh.any_hit(o, light - o, 0.0, 1.0) != between)
        judged += int(np.count_nonzero(clear))
        if wrong.any():
            worst = max(worst, abs(height) / margin)
    light = middle.astype(precision)
    return judged, worst, float(bvh.any_hit(o, light - o, 0.0, 1.0).mean())


def lights(precision: str, triangles: int, rays: int) -> dict[str, Any]:
    """Part of the margin that is needed, and rays that a light in a plane would lose without it."""
    rng = np.random.default_rng(2)
    with mpmath.workdps(50):
        found = [light_beside(rng, precision, rays) for _ in range(triangles)]
    judged, worst, stopped = zip(*found, strict=True)
    return {
        "precision": precision,
        "rays": sum(judged),
        "part of the margin needed": f"{max(worst):.1%}",
        "stopped with tmax = 1 alone": f"{np.mean(stopped):.0%}",
    }


# --- Snell's law ------------------------------------------------------------------------------------------------------


def textbook(d: Vectors, n: Vectors, eta: float) -> tuple[Vectors, np.ndarray]:
    """Snell's law as it is usually written: cancellation included."""
    eta = np.asarray(eta, d.dtype)
    cosine = (d * n).sum(axis=1, keepdims=True)
    s = (d - cosine * n) / eta
    rest = 1 - (s * s).sum(axis=1, keepdims=True)
    w = s - np.sqrt(np.maximum(rest, 0)) * n
    total = rest[:, 0] <= 0
    return np.where(total[:, None], rt.reflect(d, n), w / np.linalg.norm(w, axis=1, keepdims=True)), total


def bend_error(optics: Any, law: Law, question: tuple[Vectors, Vectors, Any], critical: bool) -> float:
    """Largest error of a law over u: of the direction, or near the critical angle the backward error."""
    d, n, eta = question
    out, total = law(d, n, eta)
    worst = 0.0
    with mpmath.workdps(optics.DIGITS):
        for w, reflected, one, normal in zip(out, total, d, n, strict=True):
            incident, up = optics.unit(optics.vector(one)), optics.unit(optics.vector(normal))
            index = mpf(float(eta))
            truth = optics.snell(incident, up, index)
            if reflected or truth.rest <= 0 or (not critical and truth.rest <= mpf("0.01")):
                continue
            if not critical:
                worst = max(worst, optics.distance(w, truth.w))
                continue
            back = optics.arriving(optics.unit(optics.vector(w)), up, index)
            worst = max(worst, optics.distance(back, incident) if back else 1.0)
    return worst / (float(np.finfo(d.dtype).eps) / 2)


ROWS = {  # of the table: indices, where angles lie, whether the backward error counts
    "1.5, 2.4: all angles": ((1.5, 2.4), ("all", "normal", "grazing"), False),
    "1 / 1.5, 1 / 2.4: through": ((1 / 1.5, 1 / 2.4), ("through", "normal"), False),
    "1 / 1.5: critical, backward": ((1 / 1.5,), ("critical",), True),
    "1.0001, 0.9999: through": ((1.0001, 0.9999), ("through", "normal"), False),
    "0.9999: critical, backward": ((0.9999,), ("critical",), True),
    "0.999999: critical, backward": ((1 - 1e-6,), ("critical",), True),
    "1000: all angles": ((1e3,), ("all", "normal", "grazing"), False),
    "1 / 1000: through": ((1e-3,), ("through", "normal"), False),
}


def snell(rays: int) -> list[dict[str, Any]]:
    """Largest errors over u of the usual formula and of ``rt.refract``."""
    sys.path.insert(0, str(ROOT / "tests"))  # the oracle is one of the tests'
    exact_optics = import_module("exact_optics")
    rows = []
    for name, (indices, where, critical) in ROWS.items():
        row: dict[str, Any] = {"eta: where": name}
        for precision, (label, law) in product(PRECISIONS, (("textbook", textbook), ("here", rt.refract))):
            error = 0.0
            for index, place in product(indices, where):
                eta = np.array(index, precision)
                at = exact_optics.angles(place, float(eta), rays, seed=3)
                d, n = exact_optics.at_angles(at, 4, precision)
                error = max(error, bend_error(exact_optics, law, (d, n, eta), critical))
            row[f"{precision}, {label}"] = error
        rows.append(row)
    return rows


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--triangles", type=int, default=2400, help="triangles that rays leave (%(default)s)")
    options.add_argument("--rays", type=int, default=1000, help="rays per triangle (%(default)s)")
    options.add_argument("--lights", type=int, default=400, help="triangles beside which lights stand (%(default)s)")
    options.add_argument(
        "--directions", type=int, default=2000, help="directions per index and range of angles (%(default)s)"
    )
    args, found = options.parse_args(), begin()
    results = {
        "points": [points(precision, args.triangles, args.rays) for precision in PRECISIONS],
        "lights": [lights(precision, args.lights, 60) for precision in PRECISIONS],
        "snell": snell(args.directions),
    }
    titles = {
        "points": "Rays that leave a triangle: roundings of gamma(3) that are needed",
        "lights": "Lights beside a triangle",
        "snell": "Snell's law, largest error over u",
    }
    for name, rows in results.items():
        show(f"{titles[name]}:\n")
        table(list(rows[0]), (list(row.values()) for row in rows))
    finish(args, found, results)


if __name__ == "__main__":
    main()
