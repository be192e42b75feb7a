"""Follow the guides docs/add-a-*.md in a copy of the project, and run their tests.

python tests/bench/guides.py                    # some minutes: the kernels are compiled anew
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from harness import begin, finish, parser, show

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from guides import GUIDES, changed_files  # noqa: E402


def follow(guide: str, folder: Path) -> tuple[int, int]:
    """Apply a guide to a copy of the project, and return the lines that it adds and the exit code of its tests."""
    for name in ("raytrace", "tests", "docs", "scenes", "pyproject.toml"):
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / name)
    lines, tests = 0, []
    for path, text in changed_files(guide, folder).items():
        old = (folder / path).read_text("utf-8").count("\n") if (folder / path).is_file() else 0
        lines += text.count("\n") - old
        (folder / path).write_text(text, "utf-8")
        tests += [path] if path.startswith("tests/test_") and not old else []
    environment = os.environ | {"PYTHONPATH": str(folder), "RAYTRACE_CACHE": str(folder / "kernels")}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:dash",
        "-q",
        *tests,
    ]  # some peers install Dash, whose plugin fails
    return lines, subprocess.run(command, cwd=folder, env=environment, check=False).returncode


def main() -> int:
    args = parser(__doc__ or "").parse_args()
    found, rows = begin(), []
    for guide in GUIDES:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as name:
            lines, code = follow(guide, Path(name))
        seconds = time.perf_counter() - began
        show(f"{guide}: {lines} lines more, tests {'pass' if code == 0 else 'fail'}, {seconds:.0f} s")
        rows.append({"guide": guide, "lines": lines, "passed": code == 0, "seconds": seconds})
    finish(args, found, {"guides": rows})
    return 0 if all(row["passed"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
