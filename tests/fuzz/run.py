"""Run cases by the thousand: ``PYTHONPATH=. python tests/fuzz/run.py scenes``, or meshes, pictures, textures, lies."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cases
import hypothesis
import lies
from mill import Case, Mill

from scenes import texts


def structured(count: int, seed: int, grind: Callable[[Case], object]) -> None:
    """Draw scenes from the schema, and grind each."""

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(texts())
    def one(text: str) -> None:
        grind(cases.scene_text(text.encode("utf-8", "surrogatepass"), f"structure {seed}"))

    one()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["scenes", "meshes", "pictures", "textures", "lies"])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the cases that show a fault")
    args = parser.parse_args()
    began, done = time.perf_counter(), 0
    with Mill(args.keep) as mill:

        def grind(case: Case) -> None:
            nonlocal done
            done += 1
            if fault := mill.grind(case):
                print(f"{case.about}: {fault}", flush=True)
            if mill.seconds > 2:
                print(f"{case.about}: {mill.seconds:.1f} s", flush=True)
            if done % 1000 == 0:
                print(
                    f"{done} cases, {time.perf_counter() - began:.0f} s, {dict(mill.counts)}",
                    file=sys.stderr,
                    flush=True,
                )

        if args.what == "lies":
            for case in lies.everything():
                grind(case)
            args.count = done
        if args.what == "scenes":
            structured(args.count // 2, args.seed, grind)
        make: dict[str, Callable[[int, int], Case]] = {
            "scenes": cases.scene_bytes,
            "meshes": cases.mesh,
            "pictures": cases.picture,
            "textures": cases.texture,
        }
        for k in range(args.count - done):
            grind(make[args.what](args.seed, k))
        print(
            f"{done} {args.what}, seed {args.seed}: {len(mill.finds)} faults in {time.perf_counter() - began:.0f} s; "
            f"exit codes {dict(sorted(mill.counts.items(), key=str))}; "
            f"slowest {mill.slowest:.2f} s, most memory {mill.largest / 2**20:.0f} MiB"
        )
    return bool(mill.finds)


if __name__ == "__main__":
    sys.exit(main())
