"""Runs commands on files that may break them, in a process that may die of it, and judges what came of each."""

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).parent
SECONDS = 20.0  # that a case may take
MEMORY = 64 * 2**20, 64  # bytes that it may take, and more for each byte of its files
ROOM = 2**30  # bytes of address space: more is a crash, or "not enough memory"
LINE = 600  # characters of a clear line
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
DONE, COMMAND, SCENE, FILE, DIFFERENT = 0, 2, 3, 4, 5  # exit codes


class Case(NamedTuple):
    """A command, and the files that it finds."""

    files: dict[str, bytes]  # by name
    words: list[str]  # of the command
    about: str = ""  # how it was made
    judge: bool = False  # whether to compare the picture with one drawn the slow way
    codes: tuple[int, ...] = (DONE, SCENE, FILE)  # that it may end with
    output: str = ""  # the picture that it may write
    unfolds: bool = False  # whether it may take all the memory that there is

    @property
    def room(self) -> int:
        """Bytes of memory that it may take."""
        return ROOM if self.unfolds else MEMORY[0] + MEMORY[1] * sum(map(len, self.files.values()))


def _lacks_memory(code: int, lines: list[str]) -> bool:
    """Whether all that is wrong is a lack of memory, which any command may end with."""
    return code == COMMAND and bool(lines) and all("memory: " in line for line in lines)


class Mill:
    """A worker, and what came of its cases: ``counts`` of exit codes, and ``finds``."""

    def __init__(self, keep: Path | None = None, program: str = "") -> None:
        self._program = program  # that the worker runs first
        self.keep, self.counts, self.finds = keep, Counter[Any](), list[tuple[str, Case]]()
        self.slowest, self.largest, self.seconds = 0.0, 0, 0.0
        self.folder = Path(tempfile.mkdtemp(prefix="raytrace-fuzz-"))
        self._worker: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Mill":
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def grind(self, case: Case) -> str:
        """Run a case; "", or what is wrong with what came of it."""
        for path in self.folder.iterdir():
            path.unlink()
        for name, data in case.files.items():
            (self.folder / name).write_bytes(data)
        answer = self._ask({"words": case.words, "folder": str(self.folder), "judge": case.judge})
        fault = answer["fault"] if "fault" in answer else self._judge(case, answer)
        self.counts["fault" if fault else answer["code"]] += 1
        self.seconds = answer.get("seconds", SECONDS)
        if fault:
            self._find(fault, case)
        return fault

    def _judge(self, case: Case, answer: dict[str, Any]) -> str:
        code, lines = answer["code"], answer["err"].splitlines()
        self.slowest, self.largest = max(self.slowest, answer["seconds"]), max(self.largest, answer["grown"])
        left = (
            {path.name for path in self.folder.iterdir()} - set(case.files) - ({case.output} if code == DONE else set())
        )
        checks = {
            f"exit code {code}: {answer['err'][-300:]}": code not in case.codes and not _lacks_memory(code, lines),
            f"wrote to the terminal by itself: {answer.get('stray')}": bool(answer.get("stray")),
            f"left {left} behind": bool(left),
            "says nothing": code in (COMMAND, SCENE, FILE) and not lines,
            f"not enough memory for a small file: {lines}": any("memory: not enough" in line for line in lines),
            f"took {answer['grown'] >> 20} MiB": answer["grown"] > case.room,
            "wrote no picture": code == DONE and bool(case.output) and not (self.folder / case.output).exists(),
            f"wrong: {answer.get('wrong')}": bool(answer.get("wrong")),
        }
        for line in lines:
            known = line.startswith((*case.files, "memory: ")) or code == DIFFERENT
            checks[f"no clear line: {line[:LINE]!r}"] = not known or len(line) > LINE or not line.isprintable()
        return next((text for text, true in checks.items() if true), "")

    def _ask(self, task: dict[str, Any]) -> dict[str, Any]:
        worker = self._start()
        assert worker.stdin is not None
        assert worker.stdout is not None
        worker.stdin.write(json.dumps(task) + "\n")
        worker.stdin.flush()
        if not select.select([worker.stdout], [], [], SECONDS)[0]:
            self._stop()
            return {"fault": f"took more than {SECONDS:g} s"}
        line = worker.stdout.readline()
        if not line:
            worker.wait()
            fault = f"the process ended with {worker.returncode}: {self._stray()[-300:]}"
            self._stop()
            return {"fault": fault}
        return json.loads(line) | {"stray": self._stray()}

    def _start(self) -> "subprocess.Popen[str]":
        if self._worker is None:
            self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed with the worker)
            words = [sys.executable, str(HERE / "worker.py"), str(ROOM), self._program]
            pipe = subprocess.PIPE
            environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
            self._worker = subprocess.Popen(
                words, stdin=pipe, stdout=pipe, stderr=self._log, text=True, env=environment, cwd=self.folder
            )
            assert self._worker.stdout is not None
            assert self._worker.stdout.readline() == "ready\n", self._stray()  # kernels may have to be compiled first
        return self._worker

    def _stray(self) -> str:
        """What the worker wrote past Python's streams since the last look."""
        self._log.seek(0)
        text = self._log.read()
        self._log.seek(0)
        self._log.truncate()
        return text

    def _stop(self) -> None:
        if self._worker is not None:
            self._worker.kill()
            self._worker.communicate()
            self._log.close()
            self._worker = None

    def _find(self, fault: str, case: Case) -> None:
        self.finds.append((fault, case))
        if self.keep:
            folder = self.keep / f"{len(self.finds):04d}"
            folder.mkdir(parents=True, exist_ok=True)
            for name, data in case.files.items():
                (folder / name).write_bytes(data)
            (folder / "fault.txt").write_text(f"{fault}\n{' '.join(case.words)}\n{case.about}\n", "utf-8", "replace")
