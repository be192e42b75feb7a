"""A temple as a mesh, made by a script: long thin triangles beside small ones, as in models of buildings.

Fluted columns that taper, rafters, tie rods and stairs give triangles that are up to 12 m long and a few millimetres
wide. Capitals, dentils and balusters give small ones. All lengths are in metres.
"""

import numpy as np

WIDTH, DEPTH, HEIGHT, PITCH = 24.0, 36.0, 8.0, 0.35  # of the hall, up to its columns' capitals; slope of the roof
COLUMNS = 8, 13  # along its width and its depth
FLUTES = 20
TURN = 0.4  # radians: the hall is not aligned with the axes of the scene
LEAST = 20_000  # triangles of the coarsest temple, about

Part = tuple[np.ndarray, np.ndarray]  # (v, 3) vertices and (m, 3) faces


def grid(points: np.ndarray) -> Part:
    """Return the triangles of an (r, c, 3) grid of points."""
    rows, columns = points.shape[:2]
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    return points.reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def prism(start: np.ndarray, end: np.ndarray, width: float, height: float) -> Part:
    """Return a beam with a rectangular section between two points."""
    along = (end - start) / np.linalg.norm(end - start)
    side = np.cross(along, (0, 1, 0) if abs(along[1]) < 0.9 else (1, 0, 0))
    side /= np.linalg.norm(side)
    up = np.cross(side, along)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2 * (width, height)
    section = corners[:, :1] * side + corners[:, 1:] * up
    points = np.concatenate([start + section, end + section])
    sides = [(k, (k + 1) % 4, 4 + k) for k in range(4)] + [((k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    return points, np.array([*sides, (0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)])


def rod(start: np.ndarray, end: np.ndarray, radius: float, strands: int, wires: int = 5) -> Part:
    """Return a straight cable: strands of so many flat sides, side by side, which touch."""
    along = (end - start) / np.linalg.norm(end - start)
    side = np.cross(along, (0.3, 1, 0.2))
    side /= np.linalg.norm(side)
    up = np.cross(side, along)
    parts = []
    for k in range(strands):
        turn = 2 * np.pi * k / strands
        centre = radius * (np.cos(turn) * side + np.sin(turn) * up) if strands > 1 else 0 * side
        angle = 2 * np.pi * np.arange(wires + 1)[:, None] / wires
        ring = centre + radius * np.sin(np.pi / max(strands, 4)) * (np.cos(angle) * side + np.sin(angle) * up)
        parts.append(grid(np.stack([start + ring, end + ring])))
    return join(parts)


def turned(profile: np.ndarray, sides: int) -> Part:
    """Return a surface of revolution about the y axis; ``profile`` holds (radius, height)."""
    angle = -2 * np.pi * np.arange(sides + 1) / sides
    x, z = profile[:, :1] * np.cos(angle), profile[:, :1] * np.sin(angle)
    return grid(np.stack([x, np.broadcast_to(profile[:, 1:], x.shape), z], -1))


def shaft(radius: float, height: float, strips: int) -> Part:
    """Return a fluted shaft that tapers to five sixths: one strip of its surface reaches from the base to the top."""
    angle = -2 * np.pi * np.arange(FLUTES * strips + 1) / (FLUTES * strips)
    depth = 1 - 0.06 * np.abs(np.sin(angle * FLUTES / 2))
    rings = [
        r * np.stack([depth * np.cos(angle), 0 * angle, depth * np.sin(angle)], -1) for r in (radius, radius * 5 / 6)
    ]
    return grid(np.stack([rings[0], rings[1] + (0, height, 0)]))


def column(detail: float) -> Part:
    """Return a column: a base and a capital of small triangles, and a shaft of long ones."""
    s = np.linspace(0, np.pi, max(round(5 * detail), 3))
    base = np.stack([0.52 + 0.12 * np.sin(s), 0.2 - 0.2 * np.cos(s)], 1)
    s = np.linspace(0, 1, max(round(9 * detail), 4))
    capital = np.stack([0.42 + 0.28 * s**2 + 0.03 * np.sin(9 * s), HEIGHT - 0.7 + 0.6 * s], 1)
    sides = max(round(28 * detail), 8)
    points, faces = shaft(0.5, HEIGHT - 1.1, max(round(6 * detail), 2))
    slab = prism(np.array([-0.8, HEIGHT - 0.05, 0]), np.array([0.8, HEIGHT - 0.05, 0]), 1.6, 0.1)
    return join([turned(base, sides), (points + (0, 0.4, 0), faces), turned(capital, sides), slab])


def roof(detail: float) -> list[Part]:
    """Return rafters and battens, a truss of tie rods under each fourth rafter, and two cables along the ridge."""
    parts, half, top = [], WIDTH / 2 + 1, HEIGHT + 1.5
    ridge = top + PITCH * half
    for number, z in enumerate(np.linspace(-DEPTH / 2 - 1, DEPTH / 2 + 1, round(30 * detail) + 2)):
        peak = np.array([0, ridge, z])
        for side in (-half, half):
            foot = np.array([side, top, z])
            parts.append(prism(foot, peak, 0.08, 0.2))
            if number % 4 == 0:
                knots = np.linspace(foot, peak, 6)
                parts += [rod(a, np.array([a[0] * 0.6, top, z]), 0.02, 3) for a in knots[1:]]
        if number % 4 == 0:
            parts.append(rod(np.array([-half, top, z]), np.array([half, top, z]), 0.03, 7))
    for k in np.linspace(0.02, 0.98, round(24 * detail) + 2):
        for side in (-half, half):
            x, y = side * (1 - k), top + (ridge - top) * k + 0.13
            parts.append(prism(np.array([x, y, -DEPTH / 2 - 1.2]), np.array([x, y, DEPTH / 2 + 1.2]), 0.05, 0.05))
    return parts


def stairs(steps: int) -> list[Part]:
    """Return steps on all four sides, and their railings: handrails and cables on balusters."""
    parts = []
    for k in range(steps):
        x, z, y = WIDTH / 2 + 1 + 0.35 * k, DEPTH / 2 + 1 + 0.35 * k, -0.16 * k - 0.08
        for a, b in (((-x, -z), (x, -z)), ((x, -z), (x, z)), ((x, z), (-x, z)), ((-x, z), (-x, -z))):
            parts.append(prism(np.array([a[0], y, a[1]]), np.array([b[0], y, b[1]]), 0.4, 0.16))
    return parts


def railings(detail: float) -> list[Part]:
    """Return balusters, small triangles, around the hall, with a handrail and cables between them."""
    s = np.linspace(0, 1, max(round(12 * detail), 5))
    one = turned(np.stack([0.05 + 0.03 * np.sin(7 * s) ** 2, s], 1), max(round(10 * detail), 5))
    parts, x, z = [], WIDTH / 2 - 0.6, DEPTH / 2 - 0.6
    for a, b in (((-x, -z), (x, -z)), ((x, -z), (x, z)), ((x, z), (-x, z)), ((-x, z), (-x, -z))):
        start, end = np.array([a[0], 0, a[1]]), np.array([b[0], 0, b[1]])
        places = np.linspace(start, end, round(np.linalg.norm(end - start) * 1.5))
        parts += [(one[0] + place, one[1]) for place in places]
        parts += [prism(start + (0, 1.02, 0), end + (0, 1.02, 0), 0.12, 0.05)]
        parts += [rod(start + (0, h, 0), end + (0, h, 0), 0.012, 5) for h in (0.25, 0.5, 0.75)]
    return parts


def hall(detail: float) -> list[Part]:
    """Return floor, columns, beams on them, and dentils."""
    parts, x, z = [], WIDTH / 2, DEPTH / 2
    across, along = np.linspace(-x, x, COLUMNS[0]), np.linspace(-z, z, COLUMNS[1])
    places = [(a, b) for a in across for b in (-z, z)] + [(a, b) for a in (-x, x) for b in along[1:-1]]
    places += [(a, b) for a in (-x / 2, x / 2) for b in along[2:-2]]
    points, faces = column(detail)
    parts += [(points + (a, 0, b), faces) for a, b in places]
    parts.append(prism(np.array([-x - 1, -0.2, 0]), np.array([x + 1, -0.2, 0]), DEPTH + 2, 0.39))
    for a, b in (((-x, -z), (x, -z)), ((x, -z), (x, z)), ((x, z), (-x, z)), ((-x, z), (-x, -z))):
        start, end = np.array([a[0], HEIGHT, a[1]]), np.array([b[0], HEIGHT, b[1]])
        parts += [prism(start + (0, h, 0), end + (0, h, 0), 1.2 + h / 2, 0.24) for h in (0.13, 0.39, 0.65, 1.3)]
        for place in np.linspace(start, end, round(np.linalg.norm(end - start) * 3 * min(detail, 2))):
            parts.append(prism(place + (-0.07, 0.95, 0), place + (0.07, 0.95, 0), 1.7, 0.2))
    return parts


def join(parts: list[Part]) -> Part:
    """Return parts as one mesh."""
    first = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    faces = [faces + start for start, (_, faces) in zip(first, parts, strict=True)]
    return np.concatenate([points for points, _ in parts]), np.concatenate(faces)


def temple(triangles: int) -> Part:
    """Return the vertices and faces of a temple of about so many triangles, at least ``LEAST``."""
    low, high = 0.3, 0.3 + (triangles / 60_000) ** 0.5
    for _ in range(6):
        detail = (low + high) / 2
        low, high = (detail, high) if len(build(detail)[1]) < triangles else (low, detail)
    points, faces = build((low + high) / 2)
    x, y, z = points.T
    return np.stack([x * np.cos(TURN) + z * np.sin(TURN), y, z * np.cos(TURN) - x * np.sin(TURN)], 1), faces


def build(detail: float) -> Part:
    return join([*hall(detail), *roof(detail), *stairs(round(8 * min(detail, 3)) + 2), *railings(detail)])
