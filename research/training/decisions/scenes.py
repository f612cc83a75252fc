"""Simulated scenes at links of all widths, for learning decisions and for testing what was learnt.

Both come from the same generator, so everything that can differ does: floors, numbers of robots,
links, sizes. A scene is encoded once and put to many links: sizes of observations and the time that
answers take are what real LiDARs, codecs and loads would change.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.answers import AnswerTimes, Pool, Weighted
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Candidate, RobotView, Snapshot, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.pace import RARER_HZ, SLOWER_HZ
from perception.fusion.base import EncodeOptions
from perception.fusion.registry import make_fusion
from research.training.plans import TEST_SEEDS
from sensing.telling import Teller
from swarm.messages import Algorithm
from worlds.base import World
from worlds.factory.scenarios import SCENARIOS
from worlds.factory.world import FactoryWorld
from worlds.registry import world_kind

DETECTOR = "factory"
FRAMES = 5900
EGOS = 2
"""Scenes of one floor."""
LATE_ANSWER_S, PROMPT_ANSWER_S = 0.4, 0.1
TRIED_FRAMES = 10.0
MIXES = ((("early", 1.0),), (("intermediate", 0.2),), (("early", 1.0), ("intermediate", 1.0)))
"""Algorithms that come late together, and how badly beside the first one."""


@dataclass(frozen=True, slots=True)
class Split:
    """What scenes are drawn from."""

    seeds: range
    """Floors."""
    robots: tuple[int, ...]
    rates_bps: tuple[float, ...]
    """Of the link; empty: any between 0.2 and 100 Mbit/s."""
    early: tuple[float, ...]
    """By how much points cost more than in the factory; empty: 1 to 15 times."""
    variants: int
    """Of one scene, each at all its rates."""
    late: float = 0.3
    """Share of variants in which answers come late."""


_FIRST = TEST_SEEDS.start + 700_000
TRAINING = Split(range(_FIRST, _FIRST + 50_000), (3, 5, 6, 8, 11), (), (), variants=3)
TEST = Split(
    range(_FIRST + 50_000, _FIRST + 100_000),
    (4, 7, 9, 10),
    (1e6, 2e6, 5e6, 20e6, 55e6),
    (1.0, 4.0, 10.0),
    variants=1,
)
DRAWN_RATES = 4
RATES_BPS = (0.2e6, 100e6)


def known() -> Knowledge:
    """What an ego of a live swarm knows before anything was measured."""
    return Knowledge.of_detector(
        DETECTOR,
        Objective(
            slower_hz=SLOWER_HZ,
            rarer_hz=RARER_HZ,
            comm_range_m=world_kind(DETECTOR).comm_range_m or Objective().comm_range_m,
        ),
    )


def scene_groups(split: Split, seed: int) -> Iterator[list[UnifiedScene]]:
    """Without end: one scene at several rates of the link, rising. Equal seeds give equal ones."""
    rng = random.Random(seed)
    knowledge = known()
    while True:
        floor = rng.choice(split.seeds)
        world = FactoryWorld(rng.choice(split.robots), floor, scenario=rng.choice(SCENARIOS))
        for ego in rng.sample(world.robots, EGOS):
            scene = analyze(_snapshot(world, rng.randrange(FRAMES), ego, knowledge), knowledge)
            if scene.candidates:
                for _ in range(split.variants):
                    yield _at_rates(_variant(scene, split, rng), _rates(split, rng))


def _snapshot(world: World, frame: int, ego: str, knowledge: Knowledge) -> Snapshot:
    """What an ego knows that has just heard everybody, without noise."""
    fusions = {name: make_fusion(name, world.detector) for name in knowledge.algorithms}
    own = world.scan(ego, frame)
    asks = {
        name: fusion.begin(own.points, own.pose.matrix()).ask() for name, fusion in fusions.items()
    }
    robots = {}
    for robot in world.robots:
        scan = world.scan(robot, frame)
        sizes = {
            name: len(
                fusion.encode(
                    scan.points,
                    EncodeOptions(
                        pose=scan.pose, reference=asks[name].reference, demand=asks[name].demand
                    ),
                )
            )
            for name, fusion in fusions.items()
            if robot != ego
        }
        teller = Teller(world, robot, instance=1, now_ns=lambda: 0)
        robots[robot] = RobotView(
            robot=robot,
            alive=True,
            beacon=teller.beacon(frame, 0, scan.pose, scan.velocity, sizes),
            beacon_age_s=0.0,
            scene=teller.description(frame, 0, scan.pose, scan.points),
            scene_age_s=0.0,
            round_trip_s=None,
            clock_offset_s=0.0,
            duplicate=False,
        )
    return Snapshot(ego, 0, 0, robots, 1e9, "prior")


def _rates(split: Split, rng: random.Random) -> Sequence[float]:
    low, high = map(math.log, RATES_BPS)
    drawn = (math.exp(rng.uniform(low, high)) for _ in range(DRAWN_RATES))
    return split.rates_bps or sorted(drawn)


def _at_rates(scene: UnifiedScene, rates_bps: Sequence[float]) -> list[UnifiedScene]:
    return [replace(scene, capacity_bps=rate_bps) for rate_bps in rates_bps]


def _variant(scene: UnifiedScene, split: Split, rng: random.Random) -> UnifiedScene:
    """The scene with observations of other sizes, and perhaps with answers that come late."""
    early = rng.choice(split.early) if split.early else 15.0 ** rng.random()
    feature = 1.0 if split.early else 0.1 ** rng.random()
    factors = {"early": early, "intermediate": feature}
    late = dict(rng.choice(MIXES)) if rng.random() < split.late else {}
    worst = rng.random()
    return replace(
        scene,
        candidates=tuple(
            _changed(c, factors, {name: worst * share for name, share in late.items()}, rng)
            for c in scene.candidates
        ),
    )


def _changed(
    candidate: Candidate,
    factors: dict[Algorithm, float],
    late: dict[Algorithm, float],
    rng: random.Random,
) -> Candidate:
    sizes = {a: round(size * factors.get(a, 1.0)) for a, size in candidate.sizes.items()}
    answers = {a: _answers(share * rng.uniform(0.8, 1.0)) for a, share in late.items()}
    return replace(candidate, sizes=sizes, answers=answers)


def _answers(late: float) -> AnswerTimes:
    """Of a robot of whose frames that share comes late at the fastest rate, not at slower ones."""
    own = _heard(LATE_ANSWER_S, late), _heard(PROMPT_ANSWER_S, 1.0 - late)
    return AnswerTimes(own=Pool.of(own), answer_s=PROMPT_ANSWER_S, frames=TRIED_FRAMES)


def _heard(answer_s: float, share: float) -> Weighted:
    return Weighted(answer_s, TRIED_FRAMES * share, TRIED_FRAMES * share)
