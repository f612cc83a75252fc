"""The scenarios that policies are compared on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ego_agent.knowledge.objective import Objective
from research.evaluation.windows.links import (
    WINDOW_S,
    Link,
    low_tier_with_telemetry,
    recorded,
    shift,
)
from research.training.plans import TEST_SEEDS
from swarm.errors import EvaluationError
from worlds.base import World
from worlds.registry import open_world, world_kind

SUITE_SEEDS = range(TEST_SEEDS.start + 500_000, TEST_SEEDS.start + 600_000)
"""Floors of the comparison; neither the detector's training nor the surrogate's uses them."""
SURROGATE_SEEDS = range(TEST_SEEDS.start + 600_000, TEST_SEEDS.start + 700_000)
"""Floors and streets that the surrogate and the quality models learn from."""
WINDOWS = 3
RINGS = 32
SAMPLED = 6
"""Frames of a control window on which precision is measured."""
NOISE_M = 0.2
SIZES = (3, 4, 5, 6, 7, 8, 9, 10, 11, 12)
"""Robots, in turn."""
PROTOCOL = "data_protocol.yaml"
LARGE = (20, 30, 40, 50)
FACTORY_SCENARIOS = 24
TRACE_ROBOTS = 6


@dataclass(frozen=True, slots=True)
class Expectation:
    """Who should take part by the paper's own reasoning, apart from the ego."""

    words: str
    wanted: frozenset[str] = frozenset()
    """All of these."""
    redundant: frozenset[str] = frozenset()
    """Not all of these: one shows what the others do."""
    somebody: bool = False
    """Anybody takes part."""

    def met(self, participants: Iterable[str], feasible: bool) -> bool:
        """Whether a choice of these participants, that the link can carry or not, is as
        expected."""
        chosen = set(participants)
        return (
            feasible
            and chosen >= self.wanted
            and not (self.redundant and chosen >= self.redundant)
            and (bool(chosen) or not self.somebody)
        )


@dataclass(frozen=True, slots=True)
class Scenario:
    """Consecutive control windows of one ego in one world on one link."""

    name: str
    robots: int
    link: Link
    seed: int = 0
    kind: str = "floor"
    """Of the factory (worlds.factory.scenarios)."""
    ego: int = 0
    """Its index among the robots."""
    pose_noise_m: float = 0.0
    rings: int = RINGS
    """Of the factory's LiDARs."""
    room: float = 1.0
    """Floor a robot of the factory, of what is usual."""
    first_frame: int = 0
    windows: int = WINDOWS
    window_frames: int = 50
    sampled: int = SAMPLED
    """Frames of a window on which precision is measured."""
    folder: Path | None = None
    """Of a recorded world, in place of a generated one."""
    generated: str = "factory"
    """The generated world."""
    expectation: Expectation | None = None

    def open(self) -> World:
        """The world; no scan is computed yet. Raises WorldError where it cannot be read."""
        return open_world(
            self.world,
            data=self.folder,
            robots=self.robots,
            seed=self.seed,
            rings=self.rings,
            room=self.room,
            scenario=self.kind,
        )

    def decision_frame(self, window: int) -> int:
        """The frame whose scene the window's decision is made from: its first."""
        return self.first_frame + window * self.window_frames

    def sampled_frames(self, window: int) -> list[int]:
        """The frames of a window on which precision is measured: the middles of
        `sampled` equal parts."""
        first = self.decision_frame(window)
        count = min(self.sampled, self.window_frames)
        return [first + int(self.window_frames * (i + 0.5) / count) for i in range(count)]

    def capacity_bps(self, window: int) -> float:
        """The mean of C(t) in a window."""
        return self.link.mean_bps(window * WINDOW_S, (window + 1) * WINDOW_S)

    def known_bps(self, window: int) -> float:
        """What the ego takes C(t) to be when it decides for the window."""
        return self.link.known_bps(window * WINDOW_S)

    @property
    def group(self) -> str:
        """What scenarios share whose windows are not independent: the floor or the recording."""
        return self.name if self.folder is None else str(self.folder)

    @property
    def comm_range_m(self) -> float:
        """How far from the ego a robot may take part, as in a swarm in such a world."""
        return world_kind(self.world).comm_range_m or Objective().comm_range_m

    @property
    def detector(self) -> str:
        """Whose quality and work count."""
        return self.generated if self.folder is None else "road"

    @property
    def world(self) -> str:
        """Whose robots these are."""
        return self.generated if self.folder is None else "opv2v"

    def setting(self) -> str:
        """In words, all that decides what is said and measured in it, apart from the frames."""
        about = f"{self.world} {self.kind} {self.seed} {self.robots} {self.ego}"
        if (self.rings, self.room) != (RINGS, 1.0):
            about += f" {self.rings} rings, room {self.room}"
        return f"{about} {self.pose_noise_m} {_fingerprint(self.folder)}"


def factory_suite() -> list[Scenario]:
    """The three motivating snapshots of the paper, FACTORY_SCENARIOS in all, and four large
    swarms; then one scenario for each recorded link that is found."""
    day, busy = shift(), shift(telemetry=True)
    seeds = iter(SUITE_SEEDS)
    named = [
        Scenario(
            "redundant-cluster", 6, day, next(seeds), "redundant-cluster", first_frame=300,
            expectation=Expectation(
                "R2, R3 and R4 drive close behind the ego: somebody helps, but not all of them",
                redundant=frozenset({"R2", "R3", "R4"}),
                somebody=True,
            ),
        ),
        Scenario(
            "blind-spot", 6, day, next(seeds), "transient-occlusion", first_frame=175, windows=1,
            expectation=Expectation(
                "R2 alone sees the worker behind the passing forklift: it takes part",
                wanted=frozenset({"R2"}),
            ),
        ),
        Scenario(
            "utilisation-85", 6, low_tier_with_telemetry(), next(seeds), first_frame=900,
            expectation=Expectation(
                "telemetry leaves 0.75 of 5 Mbit/s: somebody takes part, and the link carries it",
                somebody=True,
            ),
        ),
    ]  # fmt: skip
    suite = list(named)
    for index in range(FACTORY_SCENARIOS - len(named)):
        robots = SIZES[index % len(SIZES)]
        # Every size meets both links.
        link = busy if (index + index // len(SIZES)) % 2 else day
        suite.append(_floor(index, robots, link, next(seeds)))
    for index, robots in enumerate(LARGE):
        suite.append(_floor(index, robots, busy if index % 2 else day, next(seeds)))
    for index, link in enumerate(recorded()):
        suite.append(_floor(index, TRACE_ROBOTS, link, next(seeds)))
    return suite


def _floor(index: int, robots: int, link: Link, seed: int) -> Scenario:
    noise = NOISE_M if index % 4 in (1, 2) else 0.0
    return Scenario(
        f"floor-{robots}-{link.name}-{seed - SUITE_SEEDS.start}",
        robots,
        link,
        seed,
        ego=index % robots,
        pose_noise_m=noise,
        first_frame=(100 + 613 * index) % 5000,
    )


def recorded_suite(data: Path) -> list[Scenario]:
    """A scenario for each robot of each recording in a folder as the ego, clean and with noise.

    `data`: a recorded scenario in OPV2V's layout, or a folder of such. Raises WorldError for one
    that cannot be read, EvaluationError for one that holds too little.
    """
    folders = [data]
    if not (data / PROTOCOL).exists() and any(data.glob(f"*/{PROTOCOL}")):
        folders = sorted(path for path in data.iterdir() if path.is_dir())
        for folder in folders:
            if not (folder / PROTOCOL).exists():
                raise EvaluationError(f"{folder} is no whole recording: it has no {PROTOCOL}")
    return [scenario for folder in folders for scenario in _recording(folder)]


def _recording(folder: Path) -> Iterator[Scenario]:
    world = open_world("opv2v", data=folder)
    if len(world.robots) < 2:
        raise EvaluationError(
            f"{folder} has {len(world.robots)} robot; a decision needs at least 2"
        )
    frames = min(world.frame_count, math.ceil(WINDOW_S * world.rate_hz))
    for noise in (0.0, NOISE_M):
        for index, robot in enumerate(world.robots):
            yield Scenario(
                f"{folder.name}-{robot}{'-noisy' if noise else ''}",
                len(world.robots),
                shift(),
                ego=index,
                pose_noise_m=noise,
                windows=world.frame_count // frames,
                window_frames=frames,
                folder=folder,
            )


def _fingerprint(folder: Path | None) -> str:
    """Of a recording's files: what was measured on others under its name does not count."""
    if folder is None:
        return ""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            about = path.stat()
            known = (path.relative_to(folder), about.st_size, about.st_mtime_ns)
            digest.update(repr(known).encode())
    return digest.hexdigest()[:16]


def chosen(suite: Sequence[Scenario], names: Sequence[str]) -> list[Scenario]:
    """Those of the names, all where there is none. Raises EvaluationError for an unknown one."""
    known = {scenario.name: scenario for scenario in suite}
    for name in names:
        if name not in known:
            raise EvaluationError(f"scenario {name!r} is not known; allowed: {', '.join(known)}")
    return [known[name] for name in names] if names else list(suite)
