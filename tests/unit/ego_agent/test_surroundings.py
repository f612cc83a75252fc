"""An ego that hears its surroundings only decides as one that hears the whole site."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.robot_table import FORGET_S
from ego_agent.monitor.snapshot import Monitor
from ego_agent.monitor.surroundings import Surroundings
from ego_agent.plan.choices.scoring import Scorer
from swarm.areas import cell_of
from swarm.arrays import pack
from swarm.log import make_logger
from swarm.messages import Beacon, SceneDescription
from tests.support.ego_scenes import knowledge, objects
from tests.unit.ego_agent.test_monitor import Time

RANGE_M, HALF_M = 45.0, 70.0
SITE_M = 300.0


def surroundings() -> Surroundings:
    return Surroundings(RANGE_M, HALF_M, make_logger("test"))


def monitor(time: Time, around: Surroundings | None) -> Monitor:
    link = LinkEstimate(55e6)
    return Monitor("E", link, clock=time, monotonic=time.monotonic, surroundings=around)


def told(time: Time, robot: str, x: float, y: float, rng: np.random.Generator) -> list[object]:
    """A robot's beacon and scene, with things and robots in it that are near it."""
    now_ns = time.now_ns()
    head = {
        "robot": robot, "instance": 1, "seq": 1, "sent_ns": now_ns, "capture_ns": now_ns,
        "frame": 1, "pose": (x, y, 1.5, 0.0, 0.0, 0.0),
    }  # fmt: skip
    seen = [(x + dx, y + dy, 20.0) for dx, dy in rng.uniform(-40.0, 40.0, (12, 2))]
    return [
        msgspec.convert(
            {**head, "velocity": (0.0, 0.0, 0.0), "range_m": 50.0, "sizes": {"early": 9000}}, Beacon
        ),
        SceneDescription(
            **head,  # type: ignore[arg-type]
            objects=objects(*seen),
            visible_m=pack(rng.uniform(5.0, 45.0, (72, 1)).astype(np.float32)),
            ground_points=1,
            elapsed_ms=1.0,
        ),
    ]


def site(time: Time, rng: np.random.Generator, robots: int) -> Iterator[object]:
    for number in range(robots):
        x, y = rng.uniform(-SITE_M, SITE_M, 2)
        yield from told(time, f"R{number}", float(x), float(y), rng)


def hear(ears: Monitor, message: object) -> None:
    if isinstance(message, Beacon):
        ears.on_beacon(message)
    elif isinstance(message, SceneDescription):
        ears.on_scene(message)


def unified(ears: Monitor, time: Time) -> UnifiedScene:
    return analyze(ears.snapshot(1, time.now_ns()), knowledge())


@pytest.mark.parametrize("seed", range(6))
def test_what_it_does_not_hear_changes_nothing(seed: int) -> None:
    time, rng, around = Time(), np.random.default_rng(seed), surroundings()
    near, all_over = monitor(time, around), monitor(time, None)
    place = rng.uniform(-100.0, 100.0, 2)
    own, own_scene = told(time, "E", float(place[0]), float(place[1]), rng)
    assert isinstance(own, Beacon)
    assert isinstance(own_scene, SceneDescription)
    cells = around.around(*own.pose[:2])
    heard = 0
    for ears in (near, all_over):
        ears.note_own(own, own_scene)
    for message in site(time, rng, 400):
        assert isinstance(message, Beacon | SceneDescription)
        all_over.on_join(message.robot)
        near.on_join(message.robot)
        hear(all_over, message)
        if (type(message), cell_of(*message.pose[:2])) in cells:
            hear(near, message)
            heard += 1
    mine, theirs = unified(near, time), unified(all_over, time)
    assert heard < 400
    assert [c.robot for c in mine.candidates] == [c.robot for c in theirs.candidates]
    assert len(mine.candidates) > 3
    assert mine.unknown == theirs.unknown == 0
    assert np.array_equal(mine.objects, theirs.objects)
    for one, other in zip(mine.candidates, theirs.candidates, strict=True):
        assert np.array_equal(one.evidence, other.evidence)
        assert np.array_equal(one.area, other.area)
    robots = [c.robot for c in mine.candidates]
    scores = [Scorer(scene, knowledge()).score(robots, "early") for scene in (mine, theirs)]
    assert scores[0] == scores[1]


def test_robots_that_are_only_known_to_be_there_are_not_waited_for() -> None:
    time = Time()
    ears = monitor(time, surroundings())
    for number in range(1000):
        ears.on_join(f"R{number}")
    beacon, scene = told(time, "R7", 3.0, 4.0, np.random.default_rng(0))
    hear(ears, beacon)
    hear(ears, scene)
    view = ears.snapshot(1, time.now_ns()).robots
    assert set(view) == {"E", "R7"}
    assert view["R7"].alive
    ears.on_leave("R7")
    assert not ears.snapshot(2, time.now_ns()).robots["R7"].alive


def test_a_robot_that_has_gone_elsewhere_is_forgotten_and_known_again_when_it_is_back() -> None:
    time = Time()
    ears = monitor(time, surroundings())
    ears.on_join("R7")
    rng = np.random.default_rng(0)
    hear(ears, told(time, "R7", 3.0, 4.0, rng)[0])
    time.now_s += FORGET_S + 1.0
    assert set(ears.snapshot(1, time.now_ns()).robots) == {"E"}
    hear(ears, told(time, "R7", 3.0, 4.0, rng)[0])
    again = ears.snapshot(2, time.now_ns()).robots["R7"]
    assert again.alive
    assert not math.isinf(again.beacon_age_s)
