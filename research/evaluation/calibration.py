"""Calibrates a detector: what its raw scores mean, for each fusion algorithm, on worlds that
neither training nor evaluation uses."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from perception.detector.calibration import ALONE, Calibration, Curve, digest_of
from perception.detector.weight_files import calibration_file, weight_file
from perception.fusion.known import without_known
from perception.fusion.registry import fusion_names, make_fusion
from perception.metrics import Match, match
from perception.tally import OPERATING_IOU
from research.evaluation.sharing import RememberingFusion
from research.evaluation.splits import Part, nearest_first, simulated
from research.evaluation.workers import each
from research.training.plans import TEST_SEEDS
from swarm.errors import PerceptionError
from swarm.files import write_whole
from worlds.cooperative.fusing import Disturbance, fuse_frame
from worlds.cooperative.judging import judge

Floats = NDArray[np.float64]

CALIBRATION_SEEDS = range(TEST_SEEDS.start + 800_000, TEST_SEEDS.start + 900_000)
"""Floors and streets for nothing else."""
LEAST_CHANCE = 0.25
"""The operating point: to miss an object is taken as three times as bad as to tell of one that is
not there."""
NOISES_M = (0.0, 0.0, 0.2)
"""Of poses, in turn by chance."""
BINS = 10
STEPS = 100
RIDGE = 1e-3
"""Keeps coefficients finite where a curve's boxes can be told apart without an error."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame, fused by one algorithm."""

    algorithm: str
    helpers: int
    match: Match
    """Of the raw boxes that show no known robot."""


def calibrate(detector: str, frames: int, workers: int, output: Path | None = None) -> Calibration:
    """Measures, fits and writes the calibration of the weights that are installed.

    `frames`: at least so many, each fused by every algorithm with all robots and with some of them.
    Figures are of the half of the worlds that their curve was not fitted to. Raises PerceptionError
    for a detector without weights.
    """
    weights = weight_file(detector)
    if not weights.is_file():
        raise PerceptionError(f"there are no weights {weights}; make train CONFIG={detector}")
    parts = _parts(detector, frames)
    names = (ALONE, *fusion_names(detector))
    seen: list[list[Seen]] = [[] for _ in parts]
    for done, (at, found) in enumerate(each(partial(_see, names=names), parts, workers, detector)):
        seen[at] = found
        print(f"{detector}: {done + 1}/{len(parts)} worlds", file=sys.stderr, flush=True)
    curves = {
        name: curve_of([[s for s in p if s.algorithm == name] for p in seen]) for name in names
    }
    made = Calibration(
        detector=detector, weights=digest_of(weights), least_chance=LEAST_CHANCE, curves=curves
    )
    text = msgspec.json.format(msgspec.json.encode(made), indent=1).decode()
    write_whole(output or calibration_file(detector), text + "\n")
    return made


def _parts(detector: str, frames: int) -> list[Part]:
    return [
        replace(part, seed=part.seed - TEST_SEEDS.start + CALIBRATION_SEEDS.start)
        for part in simulated(detector, frames)
    ]


def _see(part: Part, names: Sequence[str]) -> list[Seen]:
    """Every algorithm on the frames of one world, with everyone and with some."""
    world = part.open()
    ego = world.robots[part.ego]
    fusions = {
        name: RememberingFusion(make_fusion(name, world.detector))
        for name in names
        if name != ALONE
    }
    seen = []
    for frame in part.frames:
        rng = np.random.default_rng([part.seed, frame])
        others = list(nearest_first(world, ego, frame))[1:]
        some = rng.permutation(others)[: int(rng.integers(1, len(others) + 1))].tolist()
        noise = Disturbance(pose_noise_m=float(rng.choice(NOISES_M)))
        for name in names:
            chosen: list[list[str]] = [[]] if name == ALONE else [others, some]
            for robots in chosen[: 1 if len(some) == len(others) else 2]:
                fused = fuse_frame(world, frame, ego, robots, fusions.get(name, name), noise)
                found = without_known(fused.found, fused.known)
                judged = match(*judge(world, frame, ego, found), OPERATING_IOU)
                seen.append(Seen(name, len(robots), judged))
    return seen


def curve_of(seen: Sequence[Sequence[Seen]]) -> Curve:
    """The curve of one algorithm from its frames, world by world.

    Raises PerceptionError where no box was found at all.
    """
    halves = [[one for world in seen[start::2] for one in world] for start in (0, 1)]
    everything = halves[0] + halves[1]
    if not everything or not any(len(one.match.hits) for one in everything):
        raise PerceptionError("nothing was found: there is nothing to calibrate")
    told, right, truths = [], [], sum(one.match.truths for one in everything)
    for learnt, judged in (
        (halves[0] or halves[1], halves[1]),
        (halves[1] or halves[0], halves[0]),
    ):
        fitted = _fitted(learnt)
        for one in judged:
            told.append(fitted.chance(one.match.scores, one.helpers))
            right.append(one.match.hits)
    chance, hits = np.concatenate(told), np.concatenate(right)
    published = chance >= LEAST_CHANCE
    count, found = int(published.sum()), int(hits[published].sum())
    reliability = _reliability(chance[published], hits[published])
    error = sum(number * abs(mean - share) for mean, share, number in reliability)
    return msgspec.structs.replace(
        _fitted(everything),
        precision=round(found / count, 4) if count else 0.0,
        recall=round(found / truths, 4) if truths else 0.0,
        false_per_frame=round((count - found) / len(everything), 4),
        calibration_error=round(error / count, 4) if count else 0.0,
        reliability=tuple((round(m, 4), round(s, 4), n) for m, s, n in reliability),
        frames=len(everything),
    )


def _reliability(chance: Floats, hits: NDArray[np.bool_]) -> list[tuple[float, float, int]]:
    """Mean chance told, share that was right and number of boxes, of each bin that holds any."""
    bins = np.minimum((chance * BINS).astype(np.intp), BINS - 1)
    rows = [(chance[bins == one], hits[bins == one]) for one in range(BINS)]
    return [(float(c.mean()), float(h.mean()), len(c)) for c, h in rows if len(c)]


def _fitted(seen: Sequence[Seen]) -> Curve:
    """The logistic regression of right on what a curve counts (Newton's method)."""
    curve = Curve(
        offset=0.0, slope=1.0, helpers=0.0, precision=0.0, recall=0.0, false_per_frame=0.0,
        calibration_error=0.0, frames=len(seen),
    )  # fmt: skip
    logits = [np.log(c / (1.0 - c)) for c in (curve.chance(s.match.scores, 0) for s in seen)]
    helpers = [np.full(len(s.match.scores), np.log1p(s.helpers)) for s in seen]
    logit = np.concatenate(logits)
    inputs = np.column_stack([np.ones(len(logit)), logit, np.concatenate(helpers)])
    right = np.concatenate([s.match.hits for s in seen]).astype(np.float64)
    weights = np.array([0.0, 1.0, 0.0])
    for _ in range(STEPS):
        told = 1.0 / (1.0 + np.exp(-np.clip(inputs @ weights, -30.0, 30.0)))
        slope = inputs.T @ (told - right) + RIDGE * weights
        bend = (inputs * (told * (1.0 - told))[:, None]).T @ inputs + RIDGE * np.eye(3)
        step = np.linalg.solve(bend, slope)
        weights = weights - step
        if float(np.abs(step).max()) < 1e-9:
            break
    offset, steepness, of_helpers = (round(float(value), 5) for value in weights)
    return msgspec.structs.replace(
        curve, offset=offset, slope=max(steepness, 1e-3), helpers=of_helpers
    )
