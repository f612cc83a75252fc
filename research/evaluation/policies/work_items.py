"""The two costly steps of the comparison, a scenario's window at a time, on all cores."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import ComputeModel, packaged_compute
from ego_agent.knowledge.model import Snapshot
from ego_agent.knowledge.objective import Objective
from perception.fusion.base import Fusion
from research.evaluation.result_store import ResultStore
from research.evaluation.windows import announcements
from research.evaluation.windows.announcements import Announced
from research.evaluation.windows.choice import Choice, Outcome
from research.evaluation.windows.contents import Contents, Uncoded, contents
from research.evaluation.windows.fused import packed_frames, unpacked_frames
from research.evaluation.windows.measure import NotMeasuredError, Window, packed, unpacked
from research.evaluation.windows.placed import FRAMES, STEP, Placed, placed
from research.evaluation.windows.scenarios import Scenario
from research.evaluation.windows.search import explore
from research.evaluation.windows.timing import Timing
from research.evaluation.windows.traffic import control_bps
from research.evaluation.workers import each
from swarm.errors import EvaluationError

MADE_FROM = (
    "research/evaluation/sharing.py",
    "research/evaluation/windows/frames.py", "research/evaluation/windows/announcements.py",
    "research/evaluation/windows/fused.py", "research/evaluation/windows/contents.py",
    "research/evaluation/windows/placed.py",
    "perception",
    "swarm/arrays.py", "swarm/geometry.py", "swarm/messages", "worlds",
)  # fmt: skip
"""What decides messages and fused frames, apart from what their keys name."""

Outcomes = dict[Choice, Outcome]
Place = tuple[str, int]
"""A scenario's name and the number of a window."""
R = TypeVar("R")


@dataclass(frozen=True)
class WorkItem:
    """One control window."""

    scenario: Scenario
    window: int
    algorithms: tuple[str, ...]
    heard: Announced | None = None
    placed: Placed = field(default_factory=dict)
    wanted: tuple[Choice, ...] = ()
    known: tuple[Any, ...] = ()
    """Frames that were fused before, packed."""
    compute: ComputeModel = field(default_factory=packaged_compute)
    """Of the machines that the window is played with."""

    @property
    def place(self) -> Place:
        """Its scenario's name and its number."""
        return self.scenario.name, self.window

    def knowledge(self) -> Knowledge:
        """What the ego knows beforehand."""
        return knowledge_of(self.algorithms, self.scenario)

    def heard_key(self) -> str:
        """By which messages are kept."""
        frame, reach_m = self.scenario.decision_frame(self.window), _reach_m(self.scenario)
        return f"heard {self.scenario.setting()} {frame} {reach_m} {sorted(self.algorithms)}"

    def placed_key(self) -> str:
        """By which it is kept who could be placed before."""
        frame, reach_m = self.scenario.decision_frame(self.window), _reach_m(self.scenario)
        return f"placed {self.scenario.setting()} {frame} {reach_m} {FRAMES}/{STEP}"

    def frames_key(self) -> str:
        """By which fused frames are kept: on whatever link, with whatever model of compute."""
        frames = self.scenario.sampled_frames(self.window)
        return f"frames {self.scenario.setting()} {frames}"

    def contents_key(self) -> str:
        """By which what robots have to send is kept."""
        return f"contents {self.scenario.setting()} {self.scenario.sampled_frames(self.window)}"


def knowledge_of(algorithms: Sequence[str], scenario: Scenario) -> Knowledge:
    """What an ego knows beforehand: the objective, and the algorithms that it decides among."""
    objective = Objective(comm_range_m=scenario.comm_range_m)
    return Knowledge.of_detector(scenario.detector, objective, algorithms)


def listen(items: Sequence[WorkItem], workers: int, kept: ResultStore) -> list[WorkItem]:
    """The items with what the ego has heard, and could place, when each window begins."""
    messages: list[bytes] = _kept(items, WorkItem.heard_key, _listen, workers, kept, "messages")
    before: list[Placed] = _kept(items, WorkItem.placed_key, _place, workers, kept, "placed")
    return [
        replace(item, heard=announcements.unpacked(raw), placed=known)
        for item, raw, known in zip(items, messages, before, strict=True)
    ]


def measure(items: Sequence[WorkItem], workers: int, kept: ResultStore) -> list[Outcomes]:
    """The outcomes of the items' wanted choices and of the oracle's search, in order.

    What was measured before is looked up; which of it counts does not depend on what there is.
    """
    items = [replace(item, known=tuple(kept.get(item.frames_key()) or ())) for item in items]
    found = [_looked_up(item) for item in items]
    missing = [at for at, one in enumerate(found) if one is None]
    # Large swarms take longest: begun first, they do not keep one core busy at the end.
    missing.sort(key=lambda at: -items[at].scenario.robots)
    for place, (every, considered) in _each(
        _measure, [items[at] for at in missing], workers, "measured"
    ):
        item = items[missing[place]]
        kept.put(item.frames_key(), every)
        found[missing[place]] = unpacked(considered)
    return [one for one in found if one is not None]


def count(items: Sequence[WorkItem], workers: int, kept: ResultStore) -> Contents:
    """What robots have to send in the items' windows, uncoded."""
    found = _kept(items, WorkItem.contents_key, _count, workers, kept, "counted")
    robots = {
        item.place: {robot: Uncoded(*values) for robot, values in told.items()}
        for item, told in zip(items, found, strict=True)
    }
    return Contents(items[0].scenario.open().detector, robots)


def _count(item: WorkItem) -> dict[str, tuple[float, float]]:
    told = contents(Window(item.scenario, item.window))
    return {robot: (one.points, one.objects) for robot, one in told.items()}


def _reach_m(scenario: Scenario) -> float:
    """Robots farther away cannot be candidates, wherever noise puts them."""
    return scenario.comm_range_m + 10 * scenario.pose_noise_m + 1.0


def _listen(item: WorkItem) -> bytes:
    window = Window(item.scenario, item.window)
    fusions: dict[str, Fusion] = {name: window.fusion(name) for name in item.algorithms}
    messages = announcements.heard(
        window.world,
        item.scenario.decision_frame(item.window),
        window.ego,
        fusions,
        item.scenario.pose_noise_m,
        _reach_m(item.scenario),
    )
    return announcements.packed(messages)


def _place(item: WorkItem) -> Placed:
    """Where poses are right, nobody is left out."""
    scenario = item.scenario
    if not scenario.pose_noise_m:
        return {}
    window = Window(scenario, item.window)
    return placed(
        window.world,
        scenario.decision_frame(item.window),
        window.ego,
        _reach_m(scenario),
        window.fusion("early"),
        scenario.pose_noise_m,
    )


def _looked_up(item: WorkItem) -> Outcomes | None:
    """The outcomes that count, where all of them are known."""
    try:
        return _explored(_window(item, measures=False), item)
    except NotMeasuredError:
        return None


def _measure(item: WorkItem) -> tuple[list[Any], list[Any]]:
    """All frames that are known then, and the outcomes that count."""
    window = _window(item, measures=True)
    considered = _explored(window, item)
    return packed_frames(window.known), packed(considered)


def _window(item: WorkItem, *, measures: bool) -> Window:
    timing = Timing(item.compute, control_bps(_seen(item)))
    known = unpacked_frames(list(item.known))
    return Window(item.scenario, item.window, known, timing=timing, measures=measures)


def _explored(window: Window, item: WorkItem) -> Outcomes:
    knowledge = item.knowledge()
    return explore(window, analyze(_seen(item), knowledge), knowledge, item.wanted)


def _seen(item: WorkItem) -> Snapshot:
    """What the ego knows at the beginning of the window."""
    if item.heard is None:
        raise EvaluationError(f"nothing was heard in {item.place}")
    ego = tuple(item.heard)[item.scenario.ego]
    return announcements.snapshot(ego, item.heard, item.scenario.known_bps(item.window))


def _kept(
    items: Sequence[WorkItem],
    key: Callable[[WorkItem], str],
    work: Callable[[WorkItem], R],
    workers: int,
    kept: ResultStore,
    what: str,
) -> list[R]:
    """What the work gives for each item, looked up where it is known."""
    found: list[Any] = [kept.get(key(item)) for item in items]
    missing = [at for at, one in enumerate(found) if one is None]
    for place, result in _each(work, [items[at] for at in missing], workers, what):
        found[missing[place]] = result
        kept.put(key(items[missing[place]]), result)
    return found


def _each(
    work: Callable[[WorkItem], R], items: Sequence[WorkItem], workers: int, what: str
) -> Iterator[tuple[int, R]]:
    """Places and results as they are ready, with a line of progress each."""
    if not items:
        return
    begun = time.monotonic()
    detector = items[0].scenario.open().detector
    total = sum(item.scenario.robots for item in items)
    done = 0
    for number, (place, result) in enumerate(each(work, items, workers, detector), 1):
        yield place, result
        # Said when the caller has kept it.
        done += items[place].scenario.robots
        left_s = (time.monotonic() - begun) * (total - done) / done
        print(
            f"{what}: {number}/{len(items)} windows, {items[place].scenario.name}, "
            f"about {left_s / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )
