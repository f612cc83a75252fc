"""Two egos and a robot that publishes once for both: real sessions over a real router."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from perception.fusion.base import EncodeOptions
from swarm import keyspace
from swarm.messages import Observation, ObservationRequest
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.ego_hall import (  # noqa: F401
    Crates,
    Ego,
    Hall,
    RobotStarter,
    a_hall,
    a_robot,
    a_swarm,
    an_ego,
    decision,
    observation,
)
from tests.support.ego_swarm import Swarm, factory, swarm_of, until

PROMISE_S = 30.0


class Publisher:
    """A robot that has promised to publish, and does so when a test says."""

    def __init__(self, hall: Hall, session: Session) -> None:
        self.hall = hall
        self.session = session
        self.asked: list[ObservationRequest] = []
        self.promises = True
        self.payload = Crates("").encode(hall.points, EncodeOptions())

    def answer(self, request: ObservationRequest) -> Observation:
        self.asked.append(request)
        if not self.promises:
            return observation(self.hall, "R2", request, self.payload)
        payload = b"" if request.listens else self.payload
        return observation(self.hall, "R2", request, payload, shared_s=PROMISE_S)

    def publish(self, capture_ns: int, **other: object) -> None:
        common = {"ego": "E", "request": 0, "algorithm": "early", "capture_ns": capture_ns}
        asked = ObservationRequest(**common)  # type: ignore[arg-type]
        seen = observation(self.hall, "R2", asked, self.payload, **other)
        key = keyspace.shared("test", "R2", "early")
        self.session.put(key, seen, TrafficClass.FUSION)


@pytest.fixture
def publisher(ego: Ego, hall: Hall, swarm: Swarm, robot: RobotStarter) -> Iterator[Publisher]:
    ego.loop._fusions["early"].shareable = True
    with Session(swarm.address, "test", timeout_s=60) as session:
        publisher = Publisher(hall, session)
        robot("R2", publisher.answer)
        yield publisher


def relied_upon(ego: Ego, publisher: Publisher) -> None:
    """Brings the ego to take what is published."""

    def asks_no_more() -> bool:
        before = len(publisher.asked)
        done = threading.Event()

        def publish() -> None:
            publishing = True
            while publishing:  # Once at least: an answer may come sooner than the pause ends.
                publisher.publish(ego.own().capture_ns)
                publishing = not done.wait(0.01)

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            ego.fuse("R2")
        finally:
            done.set()
            thread.join()
        return len(publisher.asked) == before

    until(asks_no_more, "the ego relies on what is published")


def fused_while(ego: Ego, publish: Callable[[int], None]) -> tuple[str, ...]:
    """Who takes part in a frame during which that is published, of the ego's capture time."""
    own = ego.own()
    thread = threading.Timer(0.05, publish, (own.capture_ns,))
    thread.start()
    try:
        return ego.loop.fuse(decision("R2"), own).participants
    finally:
        thread.join()


def test_an_ego_asks_until_something_is_published_and_then_no_more(
    ego: Ego, publisher: Publisher
) -> None:
    assert ego.fuse("R2").participants == ("R1", "R2")
    assert publisher.asked[-1].shares
    assert not publisher.asked[-1].listens
    relied_upon(ego, publisher)
    before = len(publisher.asked)
    ego.tally.take()
    assert fused_while(ego, publisher.publish) == ("R1", "R2")
    assert len(publisher.asked) == before
    tally = ego.tally.take()
    assert tally.in_time["R2"] == 1
    # What was published again for the frame before may come after that has ended.
    assert tally.received["R2", "early"] == (1 + tally.late_answers) * len(publisher.payload)


def test_frames_that_do_not_come_are_asked_for_again(ego: Ego, publisher: Publisher) -> None:
    relied_upon(ego, publisher)
    ego.loop._deadline_s = 0.2
    before = len(publisher.asked)

    def asked_again() -> bool:
        ego.fuse("R2")
        return len(publisher.asked) > before

    until(asked_again, "the ego asks again")
    assert not publisher.asked[-1].shares
    until(lambda: "R2" in ego.fuse("R2").participants, "R2 takes part again")


def test_what_another_process_publishes_is_not_fused(ego: Ego, publisher: Publisher) -> None:
    relied_upon(ego, publisher)
    ego.monitor.instance = lambda robot: 1  # type: ignore[method-assign]

    def refused() -> bool:
        own = ego.own()
        publisher.publish(own.capture_ns, instance=2)
        missing = ego.loop.fuse(decision("R2"), own).missing
        return "R2" in missing and missing["R2"].kind == "impostor"

    until(refused, "what a stranger publishes is refused")


def test_an_ego_that_does_not_share_says_so(
    ego: Ego, publisher: Publisher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ego.loop._asker, "_share", False)
    for _ in range(3):
        assert ego.fuse("R2").participants == ("R1", "R2")
    assert not any(request.shares or request.listens for request in publisher.asked)


@pytest.mark.slow
def test_real_robots_and_egos_share_and_the_last_one_is_answered_again(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Two egos of three robots: the third one encodes and sends each frame once."""
    directory = tmp_path_factory.mktemp("shared")
    with swarm_of(factory(directory / "scans", robots=3), directory) as swarm:
        swarm.router()
        swarm.robot("R1", "R2", "R3")
        session = swarm.session()
        published: list[Observation] = []
        session.subscribe(keyspace.shared("test", "R3", "*"), Observation, published.append)
        common = {"policy": "static-early", "fusion_rate_hz": "4", "deadline_s": "2"}
        first = swarm.ego(ego="R1", **common)
        swarm.ego(ego="R2", **common)
        frames = {ego: swarm.detections(session, ego) for ego in ("R1", "R2")}
        until(lambda: len(published) >= 5, "R3 publishes for both")
        # Frames that began after that hold what was published.
        for ego, heard in frames.items():
            heard.skip()
            heard.until(lambda one: "R3" in one.participants)
            assert ego in heard.all[-1].participants
        first.kill()
        # What was promised is kept, and then nothing is published any more.
        seen = -1

        def quiet() -> bool:
            nonlocal seen
            before, seen = seen, len(published)
            time.sleep(1.0)
            return seen == before == len(published)

        until(quiet, "R3 publishes no more")
        frames["R2"].skip()
        frames["R2"].until(lambda one: "R3" in one.participants)
