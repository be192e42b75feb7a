"""Plant bugs in a copy of the source, one at a time, and show which checks of light transport turn red.

No check compares with a stored image. Each copy compiles its own kernels; all of it takes ten minutes on two cores.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from harness import ROOT, begin, finish, parser, show, table

CLOSED = "test_light_transport.py::test_closed_forms[{}-float32]"
DENSITY = "test_sampling_densities.py::test_{}"
CHECKS = {  # those that need few kernels
    "closed forms": [
        CLOSED.format(name)
        for name in (
            "room of albedo 1/2 that emits, depth 1",
            "room of albedo 1/2 that emits, depth 200",
            "two opposed squares, path",
            "small tilted lamp far above a plane",
            "back of a lamp that reflects on both sides",
            "inside of a slab, depth 30",
            "convex body in an environment, path, depth 4",
        )
    ],
    "densities": [
        DENSITY.format(name)
        for name in (
            "points_of_lamps_have_the_density_of_their_directions",
            "diffuse_surfaces",
            "dielectrics_reflect_fresnels_share",
            "roulette",
        )
    ],
    "techniques": [
        f"test_light_techniques.py::test_techniques_agree_and_both_together_are_no_worse[{name}]"
        for name in ("closed room", "large lamp", "many lamps", "open sky")
    ],
    "twin": [
        f"test_naive_paths.py::test_the_twin_agrees[{name}]"
        for name in ("nested glass", "many lamps", "transparent shadows")
    ],
}
PATHS, LIGHTS, MATERIALS, COMPACTION = (f"passes/{name}.py" for name in ("paths", "lights", "materials", "compaction"))
WAVEFRONT, TABLE, SCENE = (f"rendering/{name}.py" for name in ("path_wavefront", "light_table", "path_scene"))
# name: (file, text, text instead)
BUGS: dict[str, list[tuple[str, str, str]]] = {
    "light 3 % brighter": [
        (TABLE, "part[:, :3] = each.colour", "part[:, :3] = 1.03 * each.colour"),
        (SCENE, "emission.astype(dtype)", "(1.03 * emission).astype(dtype)"),
        (SCENE, "np.append(scene.lights.environment,", "np.append(1.03 * scene.lights.environment,"),
    ],
    "both sides shine": [
        (PATHS, "cosine = -dot(load3(paths.rays.d, i, size, like), ng)\n        found",
         "cosine = dot(load3(paths.rays.d, i, size, like), ng)\n"
         "        cosine = select(cosine < 0.0, -cosine, cosine)\n        found"),
        (LIGHTS, "cosine = -dot(wi, nl)", "cosine = absolute(dot(wi, nl))"),
    ],
    "no factor (n_from / n_to)^2": [
        (MATERIALS, "select(reflected, splat(1.0, like), 1.0 / (eta * eta))", "splat(1.0, like)")
    ],
    "a depth less": [(WAVEFRONT, "range(1, scene.max_depth + 1)", "range(1, scene.max_depth)")],
    "weights do not sum to one": [
        (MATERIALS, "power_heuristic(pdf, cosine / np.pi)", "power_heuristic(pdf, 0.5 * cosine / np.pi)")
    ],
    "roulette without compensation": [
        (COMPACTION, "store3(paths.throughput, i, size, scaled(throughput, 1.0 / chance))", "pass")
    ],
    "cosine twice": [(MATERIALS, "* (cosine / np.pi)", "* (cosine * cosine / np.pi)")],
    "area density not converted": [(LIGHTS, "row_of(table.numbers, row, COLUMNS, DENSITY) * r2 / cosine",
                                    "row_of(table.numbers, row, COLUMNS, DENSITY)")],
    "lamps shadow themselves": [(LIGHTS, "end_offset(nl, minus(q, o), offset, eps)", "offset")],
    "lights drawn evenly": [(LIGHTS, "row = select(kept, row, gather(table.other, row))", "pass")],
    "uniform hemisphere": [(MATERIALS, "cosine_hemisphere(*uniform2", "hemisphere(*uniform2"),
                           (MATERIALS, "\n\n\n@kernel\ndef scatter_diffuse", "\n\n\n@inlined\ndef hemisphere(u, v):\n"
                            "    x, y, z = cosine_hemisphere(u, v)\n    s = sqrt(1.0 + z)\n"
                            "    return x * s, y * s, z * z\n\n\n@kernel\ndef scatter_diffuse")],
    "lamps brought twice": [(PATHS, "& ~brought(load(paths.state, i, like))\n        t =", "\n        t =")],
    "none": [],
}  # fmt: skip


def plant(folder: Path, changes: list[tuple[str, str, str]]) -> None:
    """Copy the package and its tests, and replace texts, each of which must be there once."""
    for name in ("raytrace", "tests", "scenes"):
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=skip)
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name, old, new in changes:
        path = folder / "raytrace" / name
        text = path.read_text("utf-8")
        if text.count(old) != 1:
            raise SystemExit(f"{name} has {text.count(old)} times: {old}")
        path.write_text(text.replace(old, new), "utf-8")


def run(changes: list[tuple[str, str, str]], thorough: bool) -> dict[str, list[str]]:
    """Tests that fail, by check: the first, or all of them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plant(folder, changes)
        environment = os.environ | {"RAYTRACE_CACHE": str(folder / "kernels"), "PYTHONPATH": str(folder)}
        command = [sys.executable, "-m", "pytest", "-q", "--tb=no", "-p", "no:cacheprovider"]
        command += [] if thorough else ["-x"]
        command += [f"tests/{check}" for checks in CHECKS.values() for check in checks]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise SystemExit(done.stdout + done.stderr)
        failed = re.findall(r"^FAILED tests/(.*?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return {name: [test for test in failed if test.startswith(tuple(checks))] for name, checks in CHECKS.items()}


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument(
        "--thorough", action="store_true", help="run all checks, not only up to the first that fails"
    )
    arguments.add_argument("--jobs", type=int, default=2, help="bugs at once (%(default)s)")
    arguments.add_argument("--only", default="", help="bugs whose name contains this text")
    args = arguments.parse_args()
    found, rows = begin(), dict[str, Any]()
    chosen = {name: changes for name, changes in BUGS.items() if args.only in name}
    with ThreadPoolExecutor(args.jobs) as pool:
        jobs = {pool.submit(run, changes, args.thorough): name for name, changes in chosen.items()}
        for job in as_completed(jobs):
            rows[jobs[job]] = job.result()
            show(f"{jobs[job]}: {sum(map(len, job.result().values()))} tests fail")
    rows = {name: rows[name] for name in chosen}
    if args.thorough:
        table(["bug", *CHECKS], ([name, *(len(row[check]) or "" for check in CHECKS)] for name, row in rows.items()))
    else:
        failed = (
            (name, [test.partition("::")[2] for tests in row.values() for test in tests]) for name, row in rows.items()
        )
        table(["bug", "the first check that fails"], ([name, *(tests or ["none"])] for name, tests in failed))
    finish(args, found, rows)
    return 0 if all(any(row.values()) == (name != "none") for name, row in rows.items()) else 1


if __name__ == "__main__":
    sys.exit(main())
