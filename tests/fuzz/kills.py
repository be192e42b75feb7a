"""Kill a render at random moments, let it go on, and compare: every picture must have the bits of an undisturbed one.

Each picture is drawn by processes of their own, as a person would: started, killed (SIGKILL) at a moment that is
uniform over the time that an undisturbed one takes, from the start of the process on, and gone on from with
``--resume``; with ``--kills 3`` three times, before it may end.
"""

import random
import subprocess
import sys
import tempfile
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]


def main() -> int:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=100, help="(%(default)s)")
    parser.add_argument("--kills", type=int, default=1, help="of each (%(default)s)")
    parser.add_argument("--scene", default="scenes/cornell-box.json", help="(%(default)s)")
    parser.add_argument("--options", default="--size 512x512 --spp 2048", help="of the render (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (%(default)s)")
    args = parser.parse_args()
    draw = random.Random(args.seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.npz"
        run(args, path).wait()  # compiles, if anything must be
        began = time.monotonic()
        if run(args, path).wait():
            return 1
        seconds, whole = time.monotonic() - began, arrays(path)
        show(f"undisturbed: {seconds:.1f} s")
        same = sum(one(args, path, seconds, whole, draw) for _ in range(args.pictures))
    show(f"{args.pictures} pictures, each killed {args.kills} times: {same} identical")
    return same < args.pictures


def one(args: Namespace, path: Path, seconds: float, whole: dict[str, bytes], draw: random.Random) -> bool:
    """Draw one picture; whether it is the same."""
    path.unlink(missing_ok=True)
    moments, kept, checkpoint = [], [], path.with_name(path.name + ".checkpoint")
    for _ in range(args.kills):
        process = run(args, path)
        moments.append(draw.uniform(0, seconds))
        try:
            process.wait(timeout=moments[-1])
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        kept.append(checkpoint.stat().st_size if checkpoint.exists() else 0)
    began = time.monotonic()
    failed = run(args, path).wait()
    rest = time.monotonic() - began
    same = not failed and arrays(path) == whole and [each.name for each in path.parent.iterdir()] == [path.name]
    told = ", ".join(f"{at:.2f} s ({size / 1e6:.1f} MB kept)" for at, size in zip(moments, kept, strict=True))
    show(f"{'same' if same else 'DIFFERENT'}: killed after {told}; the rest took {rest:.2f} s")
    return same


def run(args: Namespace, path: Path) -> subprocess.Popen:
    words = [args.scene, "-o", str(path), "--resume", "--quiet", *args.options.split()]
    return subprocess.Popen([sys.executable, "-m", "raytrace", *words], cwd=ROOT, stdout=subprocess.DEVNULL)


def arrays(path: Path) -> dict[str, bytes]:
    with np.load(path) as picture:
        return {name: picture[name].tobytes() for name in picture if name != "provenance"}


def show(line: str) -> None:
    print(line, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
