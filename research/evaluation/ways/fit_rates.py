"""Fits Q of an ego that remembers: what a contribution is worth, by form and rate.

Contributions count like observations that arrive or not, each on its own, with a probability that
depends on form and rate; at the highest rate it is `convinces`: one robot that shows a place does
not always suffice for a box in the right place. Gains and probabilities are those with the least
squares of differences within a drive, so how hard a drive is by itself plays no part. What the ego
adds that it sees itself is as in frames that stand for themselves: drives differ too little in it.
The base is then that with which the mean over drives is right.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from ego_agent.knowledge.base import FOCUSED
from ego_agent.knowledge.quality import QualityModel, quality_of
from ego_agent.knowledge.rates import RateModel
from research.evaluation.ways.sampling import (
    BETWEEN_HZ,
    FOCUSING,
    FORMS,
    OBJECTS_FROM_HZ,
    RATES_HZ,
    Look,
    Sample,
    Sampled,
    drives,
    sampled,
)
from research.evaluation.workers import each
from swarm.errors import EvaluationError
from swarm.files import write_whole
from worlds.cooperative.judging import EVALUATION_RANGES_M

Floats = NDArray[np.float64]
Kinds = Mapping[str, tuple[float, ...]]
DIGITS = 3
RIDGE = 0.03
"""Weight of a curve's neighbours' likeness: a rate that few drew stays near the next ones."""


def kinds_of(between_hz: Iterable[float]) -> Kinds:
    """Rates of each form, and of those whose robots are asked about places in between, which are
    `between_hz`."""
    falling = tuple(sorted(between_hz, reverse=True))
    return {**dict.fromkeys(FORMS, RATES_HZ), **{form + FOCUSED: falling for form in FOCUSING}}


@dataclass(frozen=True, slots=True)
class Law:
    """What contributions are worth."""

    level: float
    """AP@0.7 of an ego alone, on average over drives..."""
    own_share: float
    """...and the share of all that it sees itself then."""
    gains: Mapping[str, float]
    arrives: Mapping[str, Mapping[float, float]]
    """By kind and rate, probability that a contribution counts."""
    error: float
    """Root of the mean square of differences within a drive that were not foreseen."""
    spread: float
    """The same of the differences themselves."""


def fitted(driven: Sequence[Sampled], between_hz: Iterable[float]) -> Law:
    """The law with the least squares over all drives with more than one sample. `between_hz`: the
    rates at which places were asked about in between. Raises EvaluationError for fewer than two
    drives."""
    kinds = kinds_of(between_hz)
    used = [one for one in driven if one.looks and len(one.samples) > 1]
    if len(used) < 2:
        raise EvaluationError(f"{len(used)} drives are too few to fit; at least 2 are needed")
    start = np.concatenate([np.linspace(2.0, -0.5, len(rates)) for rates in kinds.values()])

    def residuals(raw: Floats) -> Floats:
        arrives = _arrives(raw, kinds)
        inputs, target = _within(used, arrives)
        gains = _solved(inputs, target)
        curves = _curves(raw, kinds)
        smooth = np.concatenate([np.diff(curve, 2) for curve in curves.values()]) * RIDGE
        usual = np.stack([curves[form] for form in FORMS])
        apart = (usual - usual.mean(axis=0)).ravel()
        return np.concatenate([inputs @ gains - target, smooth, apart * RIDGE])

    found = least_squares(residuals, start, diff_step=1e-3)
    arrives = _arrives(found.x, kinds)
    inputs, target = _within(used, arrives)
    steps = _solved(inputs, target)
    error = float(np.sqrt(np.mean((inputs @ steps - target) ** 2)))
    gains = dict(zip(reversed(FORMS), np.cumsum(steps).tolist(), strict=True))
    rest = [
        sample.ap_70 - float(shares(one.looks, sample, arrives) @ steps)
        for one in used
        for sample in one.samples
    ]
    own = float(np.mean([look.own for one in used for look in one.looks]))
    spread = float(np.sqrt(np.mean(target**2)))
    return Law(float(np.mean(rest)), own, gains, arrives, error, spread)


def _arrives(raw: Floats, kinds: Kinds) -> dict[str, dict[float, float]]:
    found = {}
    for kind, curve in _curves(raw, kinds).items():
        values = np.minimum.accumulate(1.0 / (1.0 + np.exp(-curve)))
        found[kind] = dict(zip(kinds[kind], values.tolist(), strict=True))
    return found


def _curves(raw: Floats, kinds: Kinds) -> dict[str, Floats]:
    """By kind, what stands for each of its rates."""
    ends = np.cumsum([len(rates) for rates in kinds.values()])[:-1]
    return dict(zip(kinds, np.split(raw, ends), strict=True))


def shares(
    looks: Sequence[Look], sample: Sample, arrives: Mapping[str, Mapping[float, float]]
) -> Floats:
    """(FORMS,): what is expected to be shown beside the ego's own share, by robots whose form
    gains at least as much as each, the least first."""
    found = np.zeros(len(FORMS))
    for look in looks:
        place = {robot: i for i, robot in enumerate(look.robots)}
        for level, _ in enumerate(FORMS):
            enough = FORMS[: len(FORMS) - level]
            missed = np.ones(len(look.weights))
            for one in sample.assignments:
                if one.algorithm in enough and one.robot in place:
                    kind = one.algorithm + FOCUSED if one.places_hz else one.algorithm
                    counts = arrives[kind][one.rate_hz]
                    missed *= 1.0 - counts * look.seen[place[one.robot]]
            found[level] += float((1.0 - missed) @ look.weights)
    return found / len(looks)


def _within(
    driven: Sequence[Sampled], arrives: Mapping[str, Mapping[float, float]]
) -> tuple[Floats, Floats]:
    inputs, target = [], []
    for one in driven:
        shown = np.array([shares(one.looks, sample, arrives) for sample in one.samples])
        ap_70 = np.array([sample.ap_70 for sample in one.samples])
        inputs.append(shown - shown.mean(axis=0))
        target.append(ap_70 - ap_70.mean())
    return np.concatenate(inputs), np.concatenate(target)


def _solved(inputs: Floats, target: Floats) -> Floats:
    return np.asarray(nnls(inputs, target)[0])


def run(counts: Mapping[str, int], frames: int, workers: int, law: Path, quality: Path) -> None:
    """Measures so many drives with each detector and fits; writes what rates are worth to `law`,
    and Q to `quality`. Raises EvaluationError for too few drives, and as `each` does."""
    rates: dict[str, RateModel] = {}
    models: dict[str, QualityModel] = {}
    for detector, count in counts.items():
        found = []
        for _, one in each(sampled, drives(detector, count, frames), workers, detector):
            found.append(one)
            print(f"{detector}: {len(found)}/{count}", file=sys.stderr, flush=True)
        between_hz = BETWEEN_HZ[detector]
        expected = fitted(found, between_hz)
        worth = {
            kind: {f"{hz:g}": round(part, 3) for hz, part in table.items()}
            for kind, table in expected.arrives.items()
        }
        rates[detector] = RateModel(
            by_algorithm={form: worth[form] for form in FORMS},
            with_places={form: worth[form + FOCUSED] for form in FOCUSING},
            places_hz={f"{hz:g}": often for hz, often in between_hz.items()},
            objects_from_hz=OBJECTS_FROM_HZ[detector],
        )
        models[detector] = model_of(expected, detector)
        spread, left = expected.spread, expected.error
        print(f"{detector}: differences within a drive {spread:.3f}, left {left:.3f}")
    write_whole(law, _plain(rates))
    write_whole(quality, _plain(models))


def _plain(models: Mapping[str, RateModel] | Mapping[str, QualityModel]) -> str:
    return msgspec.json.format(msgspec.json.encode(models), indent=1).decode() + "\n"


def model_of(law: Law, detector: str) -> QualityModel:
    """Q by the law; ways to fuse features that were not measured gain against `intermediate` what
    they do in frames that stand for themselves, at most what points do."""
    usual = quality_of(detector)
    like = {
        name: law.gains["intermediate"] * gain / usual.gain("intermediate")
        for name, gain in usual.gains.items()
    }
    most = min(1.0, law.gains["early"])
    gains = {name: min(most, gain) for name, gain in {**like, **law.gains}.items()}
    return QualityModel(
        base=round(min(1.0, max(0.0, law.level - usual.own * law.own_share)), DIGITS),
        own=usual.own,
        gains={name: round(gain, DIGITS) for name, gain in gains.items()},
        half_m=EVALUATION_RANGES_M[detector],
        calibrated=True,
    )
