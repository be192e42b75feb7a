"""Compare our mesh readers with trimesh's: import, seconds and memory of a large file, and results for hostile files.

Each file is read in its own process. Seconds are CPU time, which other work on the machine affects less.
"""

import io
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from harness import begin, finish, parser, show, table

SIDE = 388  # 2 x 388 x 388 = 301,088 triangles
SECONDS, SPACE = 60, 4 * 2**30  # of a process that reads a hostile file, and bytes of its address space
READ = """
import resource, sys, time
from pathlib import Path
path, whose, space = sys.argv[1], sys.argv[2], int(sys.argv[3])
import json, numpy
if space:
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
begun = time.process_time()
told, imported, faces = "", 0.0, 0
try:
    if whose == "raytrace":
        from raytrace.scene.meshes import read_mesh
        imported = time.process_time() - begun
        mesh = read_mesh(Path(path))
    else:
        import trimesh
        imported = time.process_time() - begun
        mesh = trimesh.load_mesh(path, process=False)
    faces, finite = len(mesh.faces), bool(numpy.isfinite(mesh.vertices[mesh.faces]).all())
    told = "" if finite else "not finite"
except BaseException as error:
    told = f"{type(error).__name__}: {error}"
lines = Path("/proc/self/status").read_text().splitlines()
peak = next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
print(json.dumps([imported, time.process_time() - begun - imported, peak, faces, told]))
"""


def grid() -> tuple[np.ndarray, np.ndarray]:
    """A wavy square of 301,088 triangles."""
    x, y = np.meshgrid(np.arange(SIDE + 1.0), np.arange(SIDE + 1.0))
    vertices = np.stack([x.ravel(), y.ravel(), np.sin(x / 9).ravel() * np.cos(y / 7).ravel()], axis=1).astype("f4")
    first = (np.arange(SIDE)[:, None] * (SIDE + 1) + np.arange(SIDE)).ravel()
    quads = np.stack([first, first + 1, first + SIDE + 2, first + SIDE + 1], axis=1)
    return vertices, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def large_files(folder: Path) -> list[Path]:
    vertices, faces = grid()
    points = "".join(f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in vertices.tolist())
    files = {"large.obj": (points + "".join(f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist())).encode()}
    head = (
        "ply\nformat {} 1.0\n" + f"element vertex {len(vertices)}\n" + "".join(f"property float {a}\n" for a in "xyz")
    )
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.zeros(len(faces), [("n", "u1"), ("f", "<i4", 3)])
    rows["n"], rows["f"] = 3, faces
    files["binary.ply"] = head.format("binary_little_endian").encode() + vertices.tobytes() + rows.tobytes()
    text = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist())
    files["text.ply"] = (head.format("ascii") + points.replace("v ", "") + text).encode()
    triangles = np.zeros(len(faces), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    triangles["v"] = vertices[faces]
    files["binary.stl"] = bytes(80) + len(faces).to_bytes(4, "little") + triangles.tobytes()
    text = io.StringIO()
    for corners in vertices[faces].tolist():
        lines = "".join(f"vertex {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in corners)
        text.write(f"facet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\n")
    files["text.stl"] = f"solid a\n{text.getvalue()}endsolid a\n".encode()
    return write(folder, files)


def write(folder: Path, files: dict[str, bytes]) -> list[Path]:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in files]


def hostile_files(folder: Path) -> list[Path]:
    """Files whose content is not what it says, named after what is wrong with them."""
    points = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    head = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    body = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n"
    binary = head.replace(b"ascii", b"binary_little_endian")
    data = np.arange(12, dtype="<f4").tobytes() + b"\3" + np.arange(3, dtype="<i4").tobytes()
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    facets = np.zeros(2, [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]).tobytes()
    return write(
        folder,
        {
            "index 9 of 4.obj": points + b"f 1 2 9\n",
            "index 0.obj": points + b"f 0 1 2\n",
            "index -9.obj": points + b"f -9 1 2\n",
            "a position nan.obj": points + b"v nan 0 0\nf 1 2 5\n",
            "a position that is a word.obj": points + b"v zero 0 0\nf 1 2 5\n",
            "a face of 2 corners.obj": points + b"f 1 2\nf 1 2 3\n",
            "a byte order mark.obj": b"\xef\xbb\xbf" + points + b"v 5 5 5\nf 1 2 3 4\n",
            "a concave polygon, area 1.obj": b"v 0 0 0\nv 2 1 0\nv 0 2 0\nv 1 1 0\nf 1 2 3 4\n",
            "1e9 faces announced.ply": head.replace(b"face 1", b"face 1000000000") + body,
            "1e9 faces announced, binary.ply": binary.replace(b"face 1", b"face 1000000000") + data,
            "1e9 vertices announced, binary.ply": binary.replace(b"vertex 4", b"vertex 1000000000") + data,
            "index 9 of 4.ply": head + body.replace(b"0 1 2\n", b"0 1 9\n"),
            "index -1.ply": head + body.replace(b"3 0 1 2\n", b"3 0 1 -1\n"),
            "a position nan.ply": head + body.replace(b"1 1 0", b"1 nan 0"),
            "the last row cut.ply": head + body[:-4],
            "1e9 triangles announced.stl": bytes(80) + (10**9).to_bytes(4, "little") + facets,
            "one byte more.stl": bytes(80) + (2).to_bytes(4, "little") + facets + b"\0",
            "a name with keywords.stl": b"solid a vertex of a facet\n" + facet + b"endsolid\n",
            "a facet of 2 corners.stl": b"solid\n" + facet.replace(b"vertex 1 0 0\n", b"") + facet + b"endsolid\n",
            "a position nan.stl": b"solid\n" + facet.replace(b"1 0 0", b"1 nan 0") + b"endsolid\n",
            "the end cut.stl": b"solid\n" + facet + facet[:40],
        },
    )


def read(path: Path, whose: str, space: int = 0) -> tuple[float, float, float, int, str]:
    """Seconds to import and to read, MiB at most, triangles, and what is said."""
    words = [sys.executable, "-c", READ, str(path), whose, str(space)]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return 0.0, float(SECONDS), 0.0, 0, f"no end within {SECONDS} s"
    lines = done.stdout.splitlines()
    return tuple(json.loads(lines[-1])) if lines else (0.0, 0.0, 0.0, 0, f"died with {done.returncode}")


def main() -> None:
    args = parser(__doc__.splitlines()[0]).parse_args()
    found, results = begin(), {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path in large_files(folder):
            runs = {"raytrace": [], "trimesh": []}
            for _ in range(args.rounds):
                for whose, seconds in runs.items():
                    seconds.append(read(path, whose)[:3])
            medians = {whose: [statistics.median(c) for c in zip(*rows, strict=True)] for whose, rows in runs.items()}
            results[path.name] = medians["raytrace"] + medians["trimesh"]
        header = ["301,088 triangles", "ours: import, s", "read, s", "MiB", "trimesh: import, s", "read, s", "MiB"]
        table(header, [[name, *row] for name, row in results.items()])
        hostile = [[path.stem, *(ending(path, folder, whose) for whose in runs)] for path in hostile_files(folder)]
        table(["file", "ours", "trimesh"], hostile)
    show(f"CPU seconds and peak memory, medians of {args.rounds} processes each, in turn")
    finish(args, found, {"large": results, "hostile": hostile})


def ending(path: Path, folder: Path, whose: str) -> str:
    """What a hostile file ends in, in a few words."""
    _, seconds, _, faces, told = read(path, whose, SPACE)
    told = told.replace(f"{folder}/", "").replace("\n", " ").replace("|", "/")[:130]
    slow = f" ({seconds:.0f} s)" if seconds > 2 else ""
    return (", ".join(filter(None, (f"{faces} triangles" if faces else "", told))) or "no triangles") + slow


if __name__ == "__main__":
    main()
