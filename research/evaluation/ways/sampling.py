"""What assignments brought, beside what their robots showed: what Q is fitted to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.quality import QualityModel
from ego_agent.plan.choices.scoring import Scorer
from research.evaluation.surrogate.samples import scene_of
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.measure import SETTLED_FRAMES, measure
from research.evaluation.ways.way import Way
from research.evaluation.windows import announcements
from research.training.plans import TEST_SEEDS
from swarm.messages import Assignment
from worlds.cooperative.judging import EVALUATION_RANGES_M

FITTING_SEEDS = range(TEST_SEEDS.start + 970_000, TEST_SEEDS.start + 1_000_000)
"""Floors and streets that nothing was trained or set on, and that test nothing."""
ROBOTS = {"factory": (6, 4, 6, 8, 5, 10), "road": (4, 3, 5, 4)}
"""In turn."""
FORMS = ("early", "intermediate", "late")
FOCUSING = ("early",)
"""Of these, whose robots can tell of places alone."""
RATES_HZ = (10.0, 5.0, 2.0, 1.0, 0.5)
BETWEEN_HZ: Mapping[str, Mapping[float, float]] = {
    "factory": {5.0: 10.0, 2.0: 10.0, 1.0: 5.0, 0.5: 5.0},
    "road": {2.0: 5.0, 1.0: 5.0, 0.5: 5.0},
}
"""By detector and rate of points, how often places are asked about in between. On the road, where
the ego drives past everything, more often is worth less."""
OBJECTS_FROM_HZ: Mapping[str, float] = {"factory": 2.0, "road": 0.0}
"""By detector, the rate of points from which on robots that are asked about places send only what
may be an object; 0: never. Where places are asked about in fewer frames, what is new is not
confirmed soon enough (docs/results.md)."""
RANDOM_WAYS = 12
"""Of each drive, beside some that are always measured."""
PAIRED_HZ = (10.0, 5.0, 2.0)
"""Rates of points that the same robots are measured with, beside all those with places asked about
in between: how much one is worth beside another must not depend on whom chance has given it to."""
LOOKS = 5
"""How often on a drive what robots show is looked at."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Look:
    """What robots show at one moment of a drive."""

    own: float
    """The share of all that can be seen that the ego sees itself."""
    robots: tuple[str, ...]
    """The others in range."""
    seen: NDArray[np.float32]
    """(robots, columns): how much each shows of what the ego does not see."""
    weights: NDArray[np.float32]
    """(columns,): in the share of all."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One way on a drive."""

    assignments: tuple[Assignment, ...]
    ap_70: float


@dataclass(frozen=True, slots=True)
class Sampled:
    """A drive: what robots showed, and what each way brought."""

    looks: tuple[Look, ...]
    samples: tuple[Sample, ...]


def drives(detector: str, count: int, frames: int) -> list[Drive]:
    """That many floors or streets; egos take turns."""
    found = []
    for i in range(count):
        robots = ROBOTS[detector][i % len(ROBOTS[detector])]
        first = 47 + (i * 811 % 5000 if detector == "factory" else i * 13 % 40)
        seed = FITTING_SEEDS.start + i
        found.append(Drive(detector, seed, robots, i % robots, first, frames))
    return found


def sampled(drive: Drive) -> Sampled:
    """Measures ways on a drive, all with memory; everything arrives at once."""
    driven = Driven(drive)
    looks = _looks(driven)
    reachable = [robot for robot in driven.nearest if all(robot in at.robots for at in looks)]
    samples = []
    between_hz = BETWEEN_HZ[driven.world.detector]
    objects_from_hz = OBJECTS_FROM_HZ[driven.world.detector]
    chosen = random_assignments(reachable, drive.seed, between_hz, objects_from_hz)
    for number, assignments in enumerate(chosen):
        found = measure(driven, Way(str(number), assignments=assignments))
        samples.append(Sample(assignments, found.tally.precision().ap_70))
    return Sampled(looks, tuple(samples))


def random_assignments(
    robots: list[str], seed: int, between_hz: Mapping[float, float], objects_from_hz: float = 0.0
) -> Iterator[tuple[Assignment, ...]]:
    """Nobody; everybody with boxes; everybody, and a random half, with points at PAIRED_HZ, and at
    all rates in `between_hz` with places asked about so often in between; and random robots, with
    one form and rate for all as often as with one for each, every other time with places. From
    `objects_from_hz` on these send only what may be an object; 0: never."""

    def sends(robot: str, form: str, hz: float, *, places: bool) -> Assignment:
        places_hz = between_hz.get(hz, 0.0) if places else 0.0
        return assignment(robot, form, hz, places_hz, objects_from_hz)

    paired = [*((hz, False) for hz in PAIRED_HZ), *((hz, True) for hz in between_hz)]
    rng = np.random.default_rng(seed)
    yield ()
    yield tuple(sends(robot, "late", 10.0, places=False) for robot in robots)
    half = [robots[i] for i in rng.permutation(len(robots))[: (len(robots) + 1) // 2]]
    for some in (robots, half):
        for hz, places in paired:
            yield tuple(sends(robot, "early", hz, places=places) for robot in some)
    for way in range(RANDOM_WAYS if robots else 0):
        count = int(rng.integers(1, len(robots) + 1))
        chosen = [robots[i] for i in rng.permutation(len(robots))[:count]]
        forms, rates = rng.choice(FORMS, count), rng.choice(RATES_HZ, count)
        if rng.random() < 0.6:
            forms[:] = forms[0]
        if rng.random() < 0.5:
            rates[:] = rates[0]
        yield tuple(
            sends(robot, str(form), float(hz), places=way % 2 == 1)
            for robot, form, hz in zip(chosen, forms, rates, strict=True)
        )


def assignment(
    robot: str, form: str, hz: float, places_hz: float, objects_from_hz: float
) -> Assignment:
    """That a robot sends this so often, and is asked about places so often where its form can tell
    of them; from `objects_from_hz` on only what may be an object then, 0: never."""
    places_hz = places_hz if form in FOCUSING else 0.0
    return Assignment(
        robot=robot,
        algorithm=form,
        rate_hz=hz,
        places_hz=places_hz,
        objects_only=places_hz > 0.0 and 0.0 < objects_from_hz <= hz,
    )


def _looks(driven: Driven) -> tuple[Look, ...]:
    at = np.linspace(SETTLED_FRAMES, len(driven.frames) - 1, LOOKS).astype(int)
    return tuple(_look(driven, driven.frames[number]) for number in at)


def _look(driven: Driven, frame: int) -> Look:
    detector = driven.world.detector
    messages = announcements.heard(
        driven.world, frame, driven.ego, {"early": driven.fusion("early")}
    )
    scene = scene_of(driven.ego, messages, detector)
    half_m = EVALUATION_RANGES_M[detector]
    scorer = Scorer(scene, Knowledge(quality=QualityModel(half_m=half_m)))
    seen, weights = scorer.views.patterns
    robots = tuple(candidate.robot for candidate in scene.candidates)
    return Look(scorer.own_share, robots, seen, weights)
