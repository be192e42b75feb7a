"""Judges the images of a renderer against the answers of a suite."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytrace.conformance.case import Cause, Region
from raytrace.conformance.hints import cause_of
from raytrace.conformance.measuring import Images, Measured, find_images, measure, read_images, unusable
from raytrace.conformance.writing import ANSWERS, SCHEMA
from raytrace.errors import FileError, RaytraceError, printable

PASSES, FAILS, UNJUDGED, MISSING = "passes", "fails", "cannot be judged", "not rendered"
UNKNOWN = "no known cause fits"
ENDS, DEEP = "Russian roulette, and paths that end early", 16  # surfaces
EVERYWHERE = "units or exposure of lights, or energy lost at surfaces"
SHARED, MANY, MOST = 0.004, 3, 10  # scenes whose errors are this close, and so many, share a cause
SIGNIFICANT, SMALL = 6.0, 2e-3  # standard errors, relative error: what is above both is worth a remark
ACCURACY = 3e-4  # relative: of the answers, for rounding, meshes, and pixels that are not points
SIGMAS = 4.0  # standard errors that noise may explain


class RegionResult(NamedTuple):
    """One region of one scene."""

    name: str
    expected: tuple[float, ...]
    measured: tuple[float, ...]
    error: float  # relative, of the worst channel, with its sign
    tolerance: float  # relative; with half a step of 8 bits
    noise: float  # relative standard error of that channel
    z: float | None  # error beyond the answer's accuracy, in standard errors; None: neither variances nor seeds
    verdict: str


class SceneResult(NamedTuple):
    """One scene."""

    name: str
    about: str
    verdict: str
    reason: str  # why it cannot be judged, or the usual cause of its error
    images: tuple[str, ...]
    regions: tuple[RegionResult, ...]

    @property
    def worst(self) -> RegionResult | None:
        """The region with the largest error in units of its tolerance."""
        return max(self.regions, key=lambda each: abs(each.error) / each.tolerance, default=None)


class Judgement(NamedTuple):
    """The results of all scenes of a suite."""

    scenes: tuple[SceneResult, ...]

    def count(self, verdict: str) -> int:
        """Return the number of scenes with a verdict."""
        return sum(scene.verdict == verdict for scene in self.scenes)

    @property
    def ok(self) -> bool:
        """Whether some scene passes, and every image that is there does."""
        return self.count(PASSES) > 0 and self.count(FAILS) == self.count(UNJUDGED) == 0


def judge(suite: Path, images: Path) -> Judgement:
    """Judge the images of a renderer.

    Parameters
    ----------
    suite : Path
        Folder that ``raytrace conformance -o`` wrote.
    images : Path
        Folder of images, found by the names of the scenes.

    Raises
    ------
    FileError
        A folder can't be read, or the first holds no suite.
    """
    answers = read_answers(suite)
    results = [_judge_scene(scene, images) for scene in answers]
    if any(result.verdict == PASSES for result in results):  # then no failure comes from the encoding of the images
        for k, result in enumerate(results):
            if result.verdict == FAILS:
                results[k] = _judge_scene(answers[k], images, encoded=False)
    return Judgement(_with_common_factor(results))


def read_answers(folder: Path) -> list[dict[str, Any]]:
    """Read the answers of a suite.

    Raises
    ------
    FileError
        The file is missing, or no suite.
    """
    path = folder / ANSWERS
    try:
        content = json.loads(path.read_text("utf-8"))
        if content["schema"] != SCHEMA:
            raise ValueError(f"schema {content['schema']!r}; this version reads {SCHEMA!r}")
        for scene in content["scenes"]:
            scene["regions"] = [_region(region) for region in scene["regions"]]
            scene["causes"] = [Cause(each["text"], tuple(map(tuple, each["expected"]))) for each in scene["causes"]]
            scene |= {key: str(scene[key]) for key in ("name", "about", "suspect")}
            scene["max_depth"] = int(scene["max_depth"])
            scene["size"] = list(scene["size"])
    except OSError as error:
        text = f"can't be read: {error.strerror}; write a suite first: raytrace conformance -o DIR"
        raise FileError(f"{printable(path)}: {text}") from error
    except (ValueError, KeyError, TypeError) as error:
        text = f"not the answers of a suite: {printable(error)}; write it again: raytrace conformance -o DIR"
        raise FileError(f"{printable(path)}: {text}") from error
    return list(content["scenes"])


def _region(given: dict[str, Any]) -> Region:
    x0, y0, x1, y1 = map(int, given["box"])
    red, green, blue = map(float, given["expected"])
    return Region(str(given["name"]), (x0, y0, x1, y1), (red, green, blue), float(given["tolerance"]))


def _judge_scene(scene: dict[str, Any], folder: Path, encoded: bool = True) -> SceneResult:
    name, about, regions = scene["name"], scene["about"], scene["regions"]
    paths = find_images(folder, name)
    files = tuple(path.name for path in paths)
    if not paths:
        return SceneResult(name, about, MISSING, "", (), ())
    try:
        images = read_images(paths)
        reason = unusable(images, regions, scene["size"])
    except (RaytraceError, ValueError) as error:
        return SceneResult(name, about, UNJUDGED, printable(error), files, ())
    if reason:
        return SceneResult(name, about, UNJUDGED, reason, files, ())
    results = tuple(_judge_region(region, measure(images, region)) for region in regions)
    verdicts = {result.verdict for result in results}
    if FAILS in verdicts:
        return SceneResult(name, about, FAILS, _cause(images, scene, encoded), files, results)
    if UNJUDGED in verdicts:
        worst = max(results, key=lambda each: each.noise / each.tolerance)
        more = math.ceil((SIGMAS * worst.noise / worst.tolerance) ** 2)
        reason = f"too noisy: its mean may be chance; render it with about {more} times the samples"
        return SceneResult(name, about, UNJUDGED, reason, files, results)
    return SceneResult(name, about, PASSES, _remark(results), files, results)


def _remark(results: tuple[RegionResult, ...]) -> str:
    """Mention an error that is within the tolerance, but no chance."""
    worst = max(results, key=lambda each: abs(each.z or 0))
    if abs(worst.z or 0) <= SIGNIFICANT or abs(worst.error) <= SMALL:
        return ""
    return f"within the tolerance, but no chance: {worst.error:+.2%}, {abs(worst.z or 0):.1f} standard errors"


def _cause(images: Images, scene: dict[str, Any], encoded: bool) -> str:
    found = cause_of(images, scene["regions"], scene["causes"], encoded)
    suspect = scene["suspect"] or (ENDS if scene["max_depth"] >= DEEP else "")
    if found.startswith("perhaps"):
        return f"{found}; or look at: {suspect}" if suspect else found
    return found or (f"{UNKNOWN}; look at: {suspect}" if suspect else UNKNOWN)


def _with_common_factor(scenes: list[SceneResult]) -> tuple[SceneResult, ...]:
    """Name a factor that several scenes without a known cause share."""
    lost = [scene for scene in scenes if scene.verdict == FAILS and scene.reason.startswith(UNKNOWN)]
    changed = {}
    for scene in scenes:
        if scene.verdict != FAILS:
            continue
        others = [other for other in lost if other is not scene and abs(_error(other) - _error(scene)) < SHARED]
        if len(others) >= (MANY if scene in lost else MOST) - 1:  # so many outweigh a cause that fits by chance
            text = f"off by a factor of {1 + _error(scene):.3f}, as {len(others)} other scenes"
            changed[scene.name] = scene._replace(reason=f"{text}: {EVERYWHERE}")
    return tuple(changed.get(scene.name, scene) for scene in scenes)


def _error(scene: SceneResult) -> float:
    return scene.worst.error if scene.worst else 0.0


def _judge_region(region: Region, measured: Measured) -> RegionResult:
    """Compare the worst channel with its answer: what is beyond the tolerance fails, unless noise may explain it."""
    right = np.array(region.expected)
    error, tolerance = measured.mean / right - 1, region.tolerance + measured.step / right
    noise = measured.noise / right
    k = int(np.argmax(np.abs(error) / tolerance))
    outside = np.abs(error) > tolerance
    certain = outside & (np.abs(error) > SIGMAS * noise)
    if certain.any():  # the worst of the channels that fail, not one that is noisier
        k = int(np.argmax(np.where(certain, np.abs(error) / tolerance, 0)))
    unclear = outside.any() or (noise > tolerance).any()  # a mean that is right by chance is no pass
    verdict = FAILS if certain.any() else UNJUDGED if unclear else PASSES
    beyond = float(np.sign(error[k])) * max(abs(float(error[k])) - ACCURACY, 0.0)
    z = beyond / float(noise[k]) if measured.known and noise[k] > 0 else None
    numbers = tuple(map(float, right)), tuple(map(float, measured.mean))
    return RegionResult(region.name, *numbers, float(error[k]), float(tolerance[k]), float(noise[k]), z, verdict)
