"""The suite of hard cases: run ray tracers on it and check their answers in exact arithmetic."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.hardcases.judge import Judge, RayQuery, Verdict, merged
from raytrace.hardcases.other_tracers import installed_tracers
from raytrace.hardcases.rays import Case, cases
from raytrace.hardcases.shadows import ShadowCase, shadow_cases
from raytrace.hardcases.tracers import Tracer, own_tracers


class Score(NamedTuple):
    """Result of one tracer in one case; NaN: nothing to measure."""

    rays: int
    wrong: int  # hits and misses that contradict the exact answer
    leaks: int  # rays that passed between neighbours of equal facing, or left a closed mesh
    self_shadows: int  # lit points that the tracer reports as shadowed
    light_leaks: int  # points behind a wall that the tracer reports as lit
    t_error: float  # largest relative error of t over well-conditioned hits
    uv_error: float  # largest error of u or v over well-conditioned hits

    @property
    def failures(self) -> int:
        """Number of all failures."""
        return self.wrong + self.leaks + self.self_shadows + self.light_leaks


class Outcome(NamedTuple):
    """Results of the suite."""

    cases: tuple[Case | ShadowCase, ...]
    tracers: tuple[Tracer, ...]
    scores: Mapping[tuple[str, str], Score]  # by (case, tracer); no entry where a tracer does not support the case
    missing: Mapping[str, str]  # tracers that are not installed, and why

    def total(self, tracer: Tracer) -> Score:
        """Sum over all cases of one tracer."""
        rows = [score for (_, name), score in self.scores.items() if name == tracer.name]
        rays, wrong, leaks, self_shadows, light_leaks = (sum(int(row[k]) for row in rows) for k in range(5))
        t, uv = (float(np.fmax.reduce([row[k] for row in rows] or [math.nan])) for k in (5, 6))
        return Score(rays, wrong, leaks, self_shadows, light_leaks, t, uv)

    @property
    def our_failures(self) -> int:
        """Number of failures of this package's own tracers."""
        return sum(self.total(tracer).failures for tracer in self.tracers if tracer.exact)


# --- run --------------------------------------------------------------------------------------------------------------


def run(
    tracers: Sequence[Tracer] | None = None,
    step: int = 1,
    progress: Callable[[str, int, int], None] | None = None,
) -> Outcome:
    """Run ray tracers on all hard cases and check their answers.

    Parameters
    ----------
    tracers : sequence of Tracer, optional
        Default: this package, the baseline, and every other tracer that is installed.
    step : int
        Use every step-th ray of each case.
    progress : callable, optional
        Called with (name of the case, its number, number of cases).

    Returns
    -------
    Outcome

    Examples
    --------
    >>> from raytrace.hardcases.tracers import Ours
    >>> outcome = run([Ours("float64")], step=199)
    >>> outcome.total(outcome.tracers[0]).light_leaks
    0
    """
    missing: dict[str, str] = {}
    if tracers is None:
        others, missing = installed_tracers()
        tracers = [*own_tracers(), *others]
    suite: tuple[Case | ShadowCase, ...] = (*cases(), *shadow_cases())
    scores: dict[tuple[str, str], Score] = {}
    for number, case in enumerate(suite):
        if progress:
            progress(case.name, number, len(suite))
        found = _rays(case, tracers, step) if isinstance(case, Case) else _shadows(case, tracers, step)
        scores.update(((case.name, name), score) for name, score in found.items())
    return Outcome(suite, tuple(tracers), scores, missing)


def _rays(case: Case, tracers: Iterable[Tracer], step: int) -> dict[str, Score]:
    judges: dict[np.dtype, Judge] = {}
    scores = {}
    for tracer in tracers:
        if tracer.dtype not in judges:
            judges[tracer.dtype] = Judge(case.query(tracer.dtype, step))
        query = judges[tracer.dtype].query
        if tracer.interval or not _has_limits(query):
            verdict = _verdict(tracer, judges[tracer.dtype])
            counts = len(query.o), int(verdict.wrong.sum()), int(verdict.leak.sum()), 0, 0
            scores[tracer.name] = Score(*counts, verdict.t_error, verdict.uv_error)
    return scores


def _has_limits(query: RayQuery) -> bool:
    return bool((query.tmin != 0).any() or (query.tmax != np.inf).any())


def _verdict(tracer: Tracer, judge: Judge) -> Verdict:
    """Check all answers of a tracer; those of an exact tracer must also be bit-identical along every path."""
    query = judge.query
    nearest, blocked = list(tracer.nearest(query)), list(tracer.blocked(query))
    verdicts = [judge.hits(hits) for hits in _different(nearest)]
    verdicts += [judge.occluded(answer) for answer in _different(blocked)]
    if tracer.exact:
        inconsistent = np.zeros(len(query.o), bool)
        for hits in nearest:
            inconsistent |= np.any([_differs(a, b) for a, b in zip(hits, nearest[0], strict=True)], axis=0)
            inconsistent |= query.tied & (hits.prim_id != judge.lowest())
        for answer in blocked:
            inconsistent |= answer != (nearest[0].prim_id >= 0)
        verdicts.append(Verdict(inconsistent, np.zeros(len(inconsistent), bool), math.nan, math.nan))
    verdict = merged(verdicts)
    return verdict._replace(wrong=verdict.wrong & ~verdict.leak)


def _differs(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray((a != b) & ~((a != a) & (b != b)))


def _different(answers: list[Any]) -> list[Any]:
    """Answers without duplicates."""
    kept: list[Any] = []
    for answer in answers:
        if not any(np.array_equal(np.stack(answer), np.stack(other), equal_nan=True) for other in kept):
            kept.append(answer)
    return kept


def _shadows(case: ShadowCase, tracers: Iterable[Tracer], step: int) -> dict[str, Score]:
    scores = {}
    for tracer in tracers:
        query = case.query(tracer.dtype, step)
        failed = np.zeros(len(query.o), bool)
        for lit in tracer.shadows(query):
            failed |= lit.found & (lit.dark != query.dark)
        count = int(failed.sum())
        counts = (0, count) if query.dark else (count, 0)
        scores[tracer.name] = Score(len(query.o), 0, 0, *counts, math.nan, math.nan)
    return scores
