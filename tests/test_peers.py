import numpy as np
import pytest

import raytrace as rt
from raytrace.hardcases import other_tracers
from raytrace.hardcases.judge import Judge
from raytrace.hardcases.rays import cases
from raytrace.hardcases.shadows import shadow_cases

PRECISIONS = ("float32", "float64")


class Known(other_tracers.OtherTracer):
    """A peer that is our own tree, but knows no tmin, and no offsets."""

    name, modules = "numpy", ("numpy",)

    def scene(self, made):
        return rt.BVH(made.vertices, made.faces, made.o.dtype.name)

    def closest(self, scene, o, d):
        return scene.closest_hit(o, d)

    def any(self, scene, o, d, tmax):
        return scene.any_hit(o, d, tmax=tmax)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("shift", [0.0, 1.0, -1e3, 1e7])
def test_offsets_are_256_ulps_or_a_small_length_along_the_normal(shift, precision):
    rng = np.random.default_rng(1)
    p = (rng.uniform(-1, 1, (300, 3)) + shift).astype(precision)
    n = rng.normal(size=(300, 3))
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(precision)
    moved = other_tracers.offset(p, n) - p
    assert (moved * n >= 0).all()
    ulps = np.abs(moved) / np.spacing(np.abs(p))
    large = np.abs(p) >= 1 / 32
    assert (ulps[large] <= 257).all()
    small = 2.0**-16 * np.finfo(precision).eps / np.finfo("float32").eps
    np.testing.assert_allclose(moved[~large], (small * n)[~large], atol=np.finfo(precision).eps / 32)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_peer_is_asked_and_lights_are_found_with_those_offsets(precision):
    peer = Known()
    query = next(cases()).query(precision, 5)
    judge = Judge(query)
    (hits,), (blocked,) = peer.nearest(query), peer.blocked(query)
    assert not judge.hits(hits).wrong.any()
    assert blocked.all()
    shadows = {case.name: case for case in shadow_cases()}
    (lit,) = peer.shadows(shadows["lit sphere, scale 1e+00"].query(precision))
    assert lit.found.all()
    assert not lit.dark.any()
    (lit,) = peer.shadows(shadows["wall at the light, scale 1e+00"].query(precision))
    assert lit.dark.all()


def test_peers_that_are_not_there_are_named_with_the_reason(monkeypatch):
    class Absent(Known):
        name, modules = "nothing", ("no_such_module_anywhere", "numpy")

    monkeypatch.setattr(other_tracers, "OTHER_TRACERS", (Known, Absent))
    found, missing = other_tracers.installed_tracers()
    assert [peer.name for peer in found] == ["numpy"]
    assert found[0].version == np.__version__
    assert missing == {"nothing": "not installed; pip install no_such_module_anywhere"}


@pytest.mark.parametrize("kind", other_tracers.OTHER_TRACERS, ids=lambda kind: kind.name)
def test_a_package_that_is_not_installed_is_the_first_thing_to_say(monkeypatch, kind):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(other_tracers, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=f"^not installed; pip install {' '.join(kind.modules)}$"):
        kind()


def test_mitsuba_is_asked_in_both_of_its_settings():
    settings = {
        kind.name: kind.robust for kind in other_tracers.OTHER_TRACERS if issubclass(kind, other_tracers.Mitsuba)
    }
    assert settings == {"Mitsuba": False, "Mitsuba, robust": True}


def test_mitsuba_is_not_tried_without_a_library_that_is_known_to_work(monkeypatch):
    monkeypatch.setattr(other_tracers, "find_spec", lambda name: True)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    with pytest.raises(ImportError, match="DRJIT_LIBLLVM_PATH"):
        other_tracers.Mitsuba()


@pytest.mark.parametrize("kind", other_tracers.OTHER_TRACERS, ids=lambda kind: kind.name)
def test_a_peer_that_is_installed_finds_a_floor_and_its_light(kind):
    try:
        peer = kind()
    except ImportError as error:
        pytest.skip(str(error))
    query = next(case for case in cases() if case.name == "icosphere, from inside").query(peer.dtype, 40)
    (hits,) = peer.nearest(query)
    verdict = Judge(query).hits(hits)
    assert verdict.wrong.mean() + verdict.leak.mean() < 0.2
    assert all(blocked.mean() > 0.8 for blocked in peer.blocked(query))
    lit = next(case for case in shadow_cases() if case.name == "wall at the light, scale 1e+00").query(peer.dtype, 10)
    assert all(found.found.all() for found in peer.shadows(lit))
