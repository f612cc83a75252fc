"""Execute: robots that send different forms, each in its turn, in one frame."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import msgspec
import pytest

from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.knowledge.pace import algorithm_of, due
from perception.detector.weight_files import has_weights
from perception.fusion.base import Contribution, EncodeOptions, Fusion
from perception.fusion.mixed import Mixed, scored_by
from perception.fusion.publishing import publish
from perception.fusion.registry import make_fusion
from perception.types import Boxes
from swarm import keyspace
from swarm.arrays import unpack_finite
from swarm.geometry import Pose
from swarm.messages import (
    MIXED,
    Assignment,
    Decision,
    Detections,
    Observation,
    ObservationRequest,
)
from swarm.session import Session
from tests.support.ego_hall import (  # noqa: F401
    Answer,
    Ego,
    Hall,
    RobotStarter,
    a_hall,
    a_robot,
    a_swarm,
    decision,
    observation,
)
from tests.support.ego_swarm import MessageLog, Swarm
from worlds.base import Scan
from worlds.factory.world import FactoryWorld

pytestmark = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")
FORMS = ("early", "late")


@pytest.fixture(scope="module", name="world")
def a_world() -> FactoryWorld:
    return FactoryWorld(robots=3, seed=1_000_003)


@pytest.fixture(scope="module", name="forms")
def real_forms() -> dict[str, Fusion]:
    return {name: make_fusion(name, "factory") for name in FORMS}


@pytest.fixture(name="ego")
def an_ego(swarm: Swarm, world: FactoryWorld, forms: dict[str, Fusion]) -> Iterator[Ego]:
    with Session(swarm.address, "test", timeout_s=60) as session:
        yield Ego(session, world, forms)


def mixed(early_hz: float = 10.0, late_hz: float = 10.0) -> Decision:
    """R2 sends points, R3 boxes."""
    return msgspec.structs.replace(
        decision("R2", "R3", algorithm=MIXED),
        assignments=(
            Assignment(robot="R2", algorithm="early", rate_hz=early_hz),
            Assignment(robot="R3", algorithm="late", rate_hz=late_hz),
        ),
    )


def honest(ego: Ego, world: FactoryWorld, forms: dict[str, Fusion], name: str) -> Answer:
    """What the robot sees in the frame that it is asked for, in the form that it is asked for."""

    def answer(asked: ObservationRequest) -> Observation:
        frame = round((asked.capture_ns - ego.epoch_ns) * 1e-9 * world.rate_hz)
        scan = world.scan(name, frame)
        reference = None if asked.reference is None else Pose(*asked.reference)
        options = EncodeOptions(pose=scan.pose, reference=reference, demand=asked.demand)
        payload = forms[asked.algorithm].encode(scan.points, options)
        return observation(world, name, asked, payload, pose=scan.pose.as_tuple(), frame=frame)

    return answer


def apart(
    world: FactoryWorld, forms: dict[str, Fusion], result: FrameResult, asked: dict[str, str]
) -> Boxes:
    """The same frame, fused by function calls."""
    own, contributions = result.own, []
    kinds = sorted({*asked.values()})
    fusion = forms[kinds[0]] if len(kinds) == 1 else Mixed({name: forms[name] for name in kinds})
    for robot, form in asked.items():
        scan = world.scan(robot, own.frame)
        ask = forms[form].begin(own.points, own.world_from_sensor).ask()
        options = EncodeOptions(pose=scan.pose, reference=ask.reference, demand=ask.demand)
        payload = forms[form].encode(scan.points, options)
        sent = Contribution(robot, payload, scan.pose.matrix())
        contributions.append(replace(sent, form=form) if len(kinds) > 1 else sent)
    found = fusion.fuse(own.points, own.world_from_sensor, contributions).boxes
    scored_as = scored_by(asked.values())
    return publish(found, world.detector, scored_as, len(asked), result.known)


def test_different_forms_are_fused_in_one_frame(
    ego: Ego, world: FactoryWorld, forms: dict[str, Fusion], robot: RobotStarter
) -> None:
    for name in ("R2", "R3"):
        robot(name, honest(ego, world, forms, name))
    result = ego.loop.fuse(mixed(), ego.own())
    assert result.participants == ("R1", "R2", "R3")
    assert result.missing == {}
    expected = apart(world, forms, result, {"R2": "early", "R3": "late"})
    assert len(expected) > 3
    assert result.boxes.centers.tolist() == expected.centers.tolist()
    assert result.boxes.scores.tolist() == expected.scores.tolist()
    assert {*ego.tally.take().received} == {("R2", "early"), ("R3", "late")}
    assert result.tracks is not None


def test_a_frame_in_which_one_form_is_due_is_that_algorithm_alone(
    ego: Ego, world: FactoryWorld, forms: dict[str, Fusion], robot: RobotStarter
) -> None:
    robot("R2", honest(ego, world, forms, "R2"))
    robot("R3", honest(ego, world, forms, "R3"))
    decided = mixed(late_hz=2.0)
    own = ego.own()
    while due(decided, "R3", own.frame):
        own = ego.own()
    result = ego.loop.fuse(decided, own)
    assert result.participants == ("R1", "R2")
    expected = apart(world, forms, result, {"R2": "early"})
    assert result.boxes.centers.tolist() == expected.centers.tolist()
    assert result.boxes.scores.tolist() == expected.scores.tolist()


def test_detections_say_what_each_has_sent(
    swarm: Swarm,
    ego: Ego,
    world: FactoryWorld,
    forms: dict[str, Fusion],
    robot: RobotStarter,
) -> None:
    for name in ("R2", "R3"):
        robot(name, honest(ego, world, forms, name))
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    ego.loop.follow(decided := mixed(late_hz=5.0))
    ego.loop.start()
    both = heard.until(lambda d: d.participants == ("R1", "R2", "R3"))
    one = heard.until(lambda d: d.participants == ("R1", "R2"))
    ego.loop.stop()
    assert (both.algorithm, both.forms) == (MIXED, {"R2": "early", "R3": "late"})
    assert one.forms == {} or one.missing
    for frame in heard.all:
        asked = {*frame.participants, *frame.missing} - {"R1"}
        assert asked == {robot for robot in ("R2", "R3") if due(decided, robot, frame.frame)}
        kinds = {algorithm_of(decided, robot) for robot in asked}
        assert frame.algorithm == (MIXED if len(kinds) > 1 else kinds.pop())


@pytest.mark.parametrize(("claims", "kind"), [("late", "rejected"), ("early", "invalid")])
def test_who_sends_another_form_than_asked_is_dropped_and_the_others_are_fused(
    ego: Ego,
    world: FactoryWorld,
    forms: dict[str, Fusion],
    robot: RobotStarter,
    claims: str,
    kind: str,
) -> None:
    """R3 sends points where boxes are asked for, whatever it calls them."""

    def points(asked: ObservationRequest) -> Observation:
        other = msgspec.structs.replace(asked, algorithm="early")
        seen = honest(ego, world, forms, "R3")(other)
        return msgspec.structs.replace(seen, algorithm=claims)

    robot("R2", honest(ego, world, forms, "R2"))
    robot("R3", points)
    result = ego.loop.fuse(mixed(), ego.own())
    assert result.missing["R3"].kind == kind
    assert result.participants == ("R1", "R2")
    assert result.tracks is not None


def test_who_ignores_its_rate_is_heard_in_its_turn_only(
    swarm: Swarm, ego: Ego, world: FactoryWorld, forms: dict[str, Fusion], robot: RobotStarter
) -> None:
    """R3 publishes again and again what it was asked for once."""
    said = threading.Event()
    done = threading.Event()
    talking: list[threading.Thread] = []

    def talkative(asked: ObservationRequest) -> Observation:
        seen = honest(ego, world, forms, "R3")(asked)

        def talk() -> None:
            while not done.wait(0.02):
                session.put(keyspace.shared("test", "R3", "late"), seen)
                said.set()

        talking.append(threading.Thread(target=talk))
        talking[-1].start()
        return seen

    session = swarm.session()
    robot("R2", honest(ego, world, forms, "R2"))
    robot("R3", talkative)
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    ego.loop.follow(decided := mixed(late_hz=2.0))
    ego.loop.start()
    try:
        heard.until(lambda d: "R3" in d.participants)
        assert said.wait(60)
        heard.until(lambda d: "R3" in d.participants)
    finally:
        done.set()
        ego.loop.stop()
        for thread in talking:
            thread.join()
    for frame in heard.all:
        if not due(decided, "R3", frame.frame):
            assert "R3" not in {*frame.participants, *frame.missing, *frame.bytes}


class Standing(FactoryWorld):
    """A floor on which nothing moves any more: what is hidden stays hidden."""

    def scan(self, robot: str, frame: int) -> Scan:
        return replace(super().scan(robot, 80), frame=frame, velocity=(0.0, 0.0, 0.0))


def ages_of(frame: Detections) -> dict[int, float]:
    """By number of each track: seconds since anybody has seen it."""
    assert frame.tracks is not None
    ages_s = unpack_finite(frame.tracks.ages_s, "ages_s", 1)[:, 0]
    return dict(zip(frame.tracks.ids, ages_s.tolist(), strict=True))


@pytest.mark.parametrize("world", [Standing(robots=3, seed=1_000_005)], ids=["standing"])
def test_who_stops_for_three_seconds_is_lived_without_and_taken_back(
    swarm: Swarm, ego: Ego, world: FactoryWorld, forms: dict[str, Fusion], robot: RobotStarter
) -> None:
    stopped, go = threading.Event(), threading.Event()
    go.set()

    def answer(asked: ObservationRequest) -> Observation:
        if not go.is_set():
            stopped.set()
            go.wait(60)
        return honest(ego, world, forms, "R2")(asked)

    robot("R2", answer)
    robot("R3", honest(ego, world, forms, "R3"))
    heard: MessageLog[Detections] = swarm.detections(swarm.session(), "R1")
    ego.loop.follow(msgspec.structs.replace(mixed(), deadline_s=0.5))
    ego.loop.start()
    try:
        begun = heard.until(lambda d: "R2" in d.participants)
        heard.until(lambda d: "R2" in d.participants and d.frame >= begun.frame + 12)
        go.clear()
        assert stopped.wait(60)
        first = heard.until(lambda d: "R2" in d.missing)
        last = heard.until(lambda d: d.capture_ns > first.capture_ns + 3_000_000_000)
        assert "R2" in last.missing
        assert any("R3" in frame.participants for frame in heard.all if frame.frame > first.frame)
        # What only R2 saw stays, and tells for how long nobody has seen it.
        shown_at_ns = {
            number: frame.capture_ns
            for frame in heard.all
            for number, age_s in ages_of(frame).items()
            if age_s == 0.0 and frame.frame <= last.frame
        }
        old = {number: age_s for number, age_s in ages_of(last).items() if age_s > 2.0}
        assert old
        for number, age_s in old.items():
            assert age_s == pytest.approx(1e-9 * (last.capture_ns - shown_at_ns[number]))
        go.set()
        heard.until(lambda d: "R2" in d.participants and d.frame > last.frame)
    finally:
        go.set()
        ego.loop.stop()
