"""Many egos on one floor: what they see together, asked one by one and published once.

Every robot of a floor is an ego. In each control window each decides as a live one would, by
`coverage` from what it has heard, with its part of the cell; `EVERYBODY` is the control: all others
take part. Each frame is fused twice with the same participants: with payloads that were encoded for
each ego alone, and with the one that a robot publishes for all who want it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.plan.decision import plan
from ego_agent.plan.policies.registry import make_policy
from perception.fusion.base import EncodeOptions, Fusion, Gathering
from perception.fusion.registry import make_fusion
from perception.metrics import Match, match
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.sharing import RememberingFusion
from research.evaluation.windows.announcements import EPOCH_NS, heard, snapshot
from research.evaluation.windows.frames import OnceWorld
from research.evaluation.windows.links import shift
from research.evaluation.windows.scenarios import SUITE_SEEDS, Scenario
from swarm.geometry import Matrix, Points
from worlds.base import World
from worlds.cooperative.fusing import SINGLE, fuse_frame
from worlds.cooperative.judging import judge

ALGORITHMS = ("early", "late")
"""Those whose payloads several egos can fuse."""
IOU = 0.7


@dataclass(frozen=True, slots=True)
class WindowRequest:
    """What one ego asks for in a window."""

    participants: tuple[str, ...]
    algorithm: str
    cost_bytes: int
    """A frame, as the ego expects."""
    fits: bool
    """The ego's part of the cell carries it."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame of one ego."""

    alone: Match
    """Fused of payloads that were made for this ego."""
    shared: Match
    """Fused of those that were made for all who want them."""
    single_bytes: Mapping[str, int]
    """Of each participant's payload for this ego."""
    shared_bytes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Floor:
    """A floor and the frames of it that are measured."""

    seed: int
    robots: int
    rings: int
    frames: tuple[int, ...]
    """The first one is the one that decisions are made from."""

    def scenario(self) -> Scenario:
        """As the comparison of policies has it."""
        return Scenario(
            f"egos-{self.seed}", self.robots, shift(), SUITE_SEEDS.start + self.seed,
            rings=self.rings,
        )  # fmt: skip


class PublishedOnce(Fusion):
    """A fusion whose robots send what they would publish for these egos."""

    def __init__(self, fusion: Fusion, world: World, frame: int, egos: Sequence[str]) -> None:
        self.name = fusion.name
        self.corrects = fusion.corrects
        self.scored_as = fusion.scored_as
        self._fusion = fusion
        self._egos = tuple(world.pose(ego, frame) for ego in egos)

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """See `Fusion.encode`; what the one ego wants plays no part."""
        form = EncodeOptions(
            options.max_error_m, options.keep_ground, options.pose, egos=self._egos
        )
        return self._fusion.encode(points, form)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """See `Fusion.begin`."""
        return self._fusion.begin(own, world_from_own)


class Egos:
    """All egos of one floor."""

    def __init__(self, floor: Floor) -> None:
        self._floor = floor
        self._scenario = floor.scenario()
        self.world = OnceWorld(self._scenario.open())
        self.knowledge: Knowledge = knowledge_of(ALGORITHMS, self._scenario)
        self._fusions = {
            name: RememberingFusion(make_fusion(name, self.world.detector)) for name in ALGORITHMS
        }

    def decisions(self, each_bps: float) -> dict[str, WindowRequest]:
        """What each ego decides, with so much of the cell."""
        found = {}
        for ego in self.world.robots:
            fusions: dict[str, Fusion] = dict(self._fusions)
            reach_m = self.knowledge.objective.comm_range_m
            told = heard(self.world, self._floor.frames[0], ego, fusions, reach_m=reach_m)
            seen = snapshot(ego, told, each_bps)
            scene = analyze(seen, self.knowledge)
            policy = make_policy("coverage", ALGORITHMS)
            decision = plan(seen, scene, policy, self.knowledge, None, 1, EPOCH_NS)
            others = tuple(robot for robot in decision.participants if robot != ego)
            found[ego] = WindowRequest(
                others,
                decision.algorithm,
                decision.cost_bytes,
                decision.valid and 8.0 * decision.cost_bytes * decision.rate_hz <= each_bps,
            )
        return found

    def everybody(self, algorithm: str) -> dict[str, WindowRequest]:
        """Every ego asks all others, whatever that takes."""
        robots = self.world.robots
        return {
            ego: WindowRequest(tuple(r for r in robots if r != ego), algorithm, 0, True)
            for ego in robots
        }

    def frame(self, frame: int, asked: Mapping[str, WindowRequest]) -> dict[str, Seen]:
        """Each ego's frame, fused both ways."""
        return {ego: self._seen(frame, ego, one, asked) for ego, one in asked.items()}

    def _seen(
        self, frame: int, ego: str, one: WindowRequest, asked: Mapping[str, WindowRequest]
    ) -> Seen:
        world, reader = self.world, one.algorithm
        if not one.participants:
            fused = fuse_frame(world, frame, ego, (), SINGLE)
            alone = match(*judge(world, frame, ego, fused.boxes), IOU)
            return Seen(alone, alone, {}, {})
        single = self._fusions[reader]
        with_all = _Each(
            {robot: self._form(frame, robot, reader, asked) for robot in one.participants},
            world,
            frame,
            single,
        )
        found = []
        for fusion in (single, with_all):
            fused = fuse_frame(world, frame, ego, one.participants, fusion)
            found.append((match(*judge(world, frame, ego, fused.boxes), IOU), fused.bytes))
        (alone, single_bytes), (shared, shared_bytes) = found
        told = single.begin(world.scan(ego, frame).points, world.pose(ego, frame).matrix()).ask()
        return Seen(
            alone,
            shared,
            {robot: size - told.size() for robot, size in single_bytes.items()},
            {robot: size - told.size() for robot, size in shared_bytes.items()},
        )

    def _form(
        self, frame: int, robot: str, algorithm: str, asked: Mapping[str, WindowRequest]
    ) -> PublishedOnce:
        """What a robot publishes for those who want it in this algorithm."""
        egos = [
            ego
            for ego, one in asked.items()
            if one.algorithm == algorithm and robot in one.participants
        ]
        return PublishedOnce(self._fusions[algorithm], self.world, frame, sorted(egos))


class _Each(Fusion):
    """A fusion whose robots send each in a form of its own."""

    def __init__(
        self, forms: Mapping[str, Fusion], world: World, frame: int, fusion: Fusion
    ) -> None:
        self.name = fusion.name
        self.corrects = fusion.corrects
        self.scored_as = fusion.scored_as
        self._fusion = fusion
        self._forms = {world.pose(robot, frame).as_tuple(): form for robot, form in forms.items()}

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        assert options.pose is not None
        return self._forms[options.pose.as_tuple()].encode(points, options)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        return self._fusion.begin(own, world_from_own)
