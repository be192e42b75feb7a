"""A thinned suite: ours has no failures, and faults that are planted are found and named for what they are."""

import numpy as np
import pytest

from raytrace.hardcases import suite
from raytrace.hardcases.suite import Outcome, Score, run
from raytrace.hardcases.tracers import Baseline, Lit, Ours

pytestmark = pytest.mark.engine

STEP = 7  # every 7th ray of each case: a prime, so that no kind of ray is left out
PRECISIONS = ("float32", "float64")
T_LIMIT = {"float32": 1e-6, "float64": 1e-14}  # relative, of well-conditioned hits
UV_LIMIT = {"float32": 1e-5, "float64": 1e-13}


class Changed(Ours):
    """Ours, with answers that are changed on the way."""

    hit = staticmethod(lambda query, hits, path: hits)
    block = staticmethod(lambda query, blocked, path: blocked)
    light = staticmethod(lambda query, dark: dark)

    def nearest(self, asked):
        for path, hits in enumerate(super().nearest(asked)):
            yield self.hit(asked, hits, path)

    def blocked(self, asked):
        for path, blocked in enumerate(super().blocked(asked)):
            yield self.block(asked, blocked, path)

    def shadows(self, asked):
        for lit in super().shadows(asked):
            yield Lit(lit.found, self.light(asked, lit.dark))


@pytest.fixture
def few(monkeypatch):
    """A few cases of every kind, for faults that are planted."""
    names = "cube, from", "lattice rays", "huge", "duplicates", "grazing", "ends", "not finite"
    kept = [case for case in suite.cases() if any(name in case.name for name in names)]
    lit = [case for case in suite.shadow_cases() if "1e+00" in case.name or "sphere, scale 1e+06" in case.name]
    monkeypatch.setattr(suite, "cases", lambda: kept)
    monkeypatch.setattr(suite, "shadow_cases", lambda: lit)
    return len(kept) + len(lit)


def changed(**changes):
    """Totals of a tracer so changed; it promises nothing of ties and paths."""
    tracer = type("Changed", (Changed,), {name: staticmethod(change) for name, change in changes.items()})("float32")
    tracer.exact = False
    outcome = run([tracer], step=7)
    return outcome.total(tracer)


def test_ours_has_no_failures_along_any_path():
    ours = [Ours(precision) for precision in PRECISIONS]
    outcome = run(ours, STEP)
    failed = {case: score for case, score in outcome.scores.items() if score.failures}
    assert not failed
    assert outcome.our_failures == 0
    for tracer in ours:
        total = outcome.total(tracer)
        assert total.rays > 2500
        assert total.t_error < T_LIMIT[tracer.dtype.name]
        assert total.uv_error < UV_LIMIT[tracer.dtype.name]


def test_the_other_triangle_test_answers_every_case_along_every_path():
    """Wrongly, as it must: with a constant threshold. But it ends, and names triangles that there are."""
    others = [Baseline(precision) for precision in PRECISIONS]
    outcome = run(others, STEP)
    assert {case.name for case in outcome.cases} == {case for case, _ in outcome.scores}
    for tracer in others:
        assert outcome.total(tracer).rays > 2500
        assert outcome.total(tracer).failures > 300
    for case in suite.cases():
        query = case.query("float32", STEP)
        for hits in others[0].nearest(query):
            assert ((hits.prim_id >= -1) & (hits.prim_id < len(query.faces))).all()
            assert (np.isinf(hits.t) == (hits.prim_id < 0)).all()


def test_the_baseline_has_failures_of_every_kind(few):
    baseline = Baseline("float32")
    outcome = run([baseline], step=2)
    total = outcome.total(baseline)
    assert min(total.wrong, total.leaks, total.self_shadows, total.light_leaks) > 0
    assert outcome.our_failures == 0  # it is not ours


def test_hits_that_are_off_are_wrong(few):
    shifted = changed(hit=lambda query, hits, path: hits._replace(t=hits.t * np.float32(1 + 1e-4)))
    assert shifted.wrong > 100
    assert shifted.leaks == 0
    np.testing.assert_allclose(shifted.t_error, 1e-4, rtol=0.01)
    swapped = changed(hit=lambda query, hits, path: hits._replace(u=hits.v, v=hits.u))
    assert swapped.failures == 0  # u and v are shown, and not counted
    assert swapped.uv_error > 0.1


def test_lost_hits_are_wrong_or_leak(few):
    def lose(query, hits, path):
        odd = np.arange(len(hits.t)) % 2 == 1
        return hits._replace(t=np.where(odd, hits.t, np.inf), prim_id=np.where(odd, hits.prim_id, -1))

    lost = changed(hit=lose)
    assert lost.leaks > 80
    assert lost.wrong > 10
    assert lost.self_shadows == lost.light_leaks == 0


def test_any_hit_is_judged_as_well(few):
    assert changed(block=lambda query, blocked, path: ~blocked).failures > 300
    assert changed(block=lambda query, blocked, path: blocked & (path != 4)).failures > 200


def test_shadows_are_judged(few):
    flipped = changed(light=lambda query, dark: ~dark)
    assert flipped.wrong == flipped.leaks == 0
    assert flipped.self_shadows > 50
    assert flipped.light_leaks > 30


@pytest.mark.parametrize(
    "change",
    [
        {"hit": lambda query, hits, path: hits._replace(u=np.where(path == 3, np.nextafter(hits.u, 2), hits.u))},
        {"block": lambda query, blocked, path: blocked ^ (path == 5)},
        {"hit": lambda query, hits, path: hits._replace(prim_id=np.where(hits.prim_id == 7, 8, hits.prim_id))},
    ],
    ids=["another bit", "any-hit against closest-hit", "a later triangle of equal ones"],
)
def test_one_answer_along_all_paths_and_the_lowest_of_ties_is_part_of_ours(few, change):
    tracer = type("Changed", (Changed,), {name: staticmethod(value) for name, value in change.items()})("float64")
    assert run([tracer], step=7).our_failures > 0


def test_a_tracer_without_an_interval_is_not_asked_for_one(few):
    tracer = Ours("float32")
    tracer.interval = False
    outcome = run([tracer], step=7)
    assert {case.name for case in outcome.cases if (case.name, tracer.name) not in outcome.scores} == {
        "ends of the interval"
    }


def test_scores_add_up_and_progress_is_told(few):
    told = []
    outcome = run([], step=7, progress=lambda *event: told.append(event))
    assert [event[1] for event in told] == list(range(len(outcome.cases)))
    assert {event[2] for event in told} == {len(outcome.cases)}
    ours = Ours("float32")
    nan = float("nan")
    scores = {("a", ours.name): Score(10, 1, 2, 3, 4, 1e-7, nan), ("b", ours.name): Score(5, 1, 0, 0, 0, nan, nan)}
    outcome = Outcome((), (ours,), scores, {})
    total = outcome.total(ours)
    assert total[:6] == (15, 2, 2, 3, 4, 1e-7)
    assert np.isnan(total.uv_error)
    assert outcome.our_failures == total.failures == 11


def test_peers_that_are_missing_are_told(monkeypatch):
    monkeypatch.setattr(suite, "installed_tracers", lambda: ([], {"Embree": "not here"}))
    monkeypatch.setattr(suite, "own_tracers", list)
    outcome = run()
    assert outcome.missing == {"Embree": "not here"}
    assert outcome.tracers == ()
