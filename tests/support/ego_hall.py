"""A small hall, an ego's executing half in it on a real session, and robots that answer as a test
says. Test files import the fixtures that they use."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.execute.sense import OwnFrame
from ego_agent.metrics import EgoMetrics
from ego_agent.settings import EgoSettings
from ego_agent.wiring import ego_of
from perception.codec.points import decode_points, encode_points
from perception.fusion.base import Contribution, EncodeOptions, Fusion, Gathering
from perception.types import Boxes, clean_points
from robot_agent.duty import OBSERVE_WORKERS
from swarm import keyspace
from swarm.errors import WorldError
from swarm.geometry import Matrix, Points, Pose, transform
from swarm.log import make_logger
from swarm.messages import Decision, Observation, ObservationRequest
from swarm.session import Session
from tests.support.ego_swarm import Swarm, swarm_of, until
from worlds.base import GroundTruth, Scan, World

BOX = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 3), axis=-1).reshape(-1, 3)
DEADLINE_S = 5.0
"""Nothing waits that long but for a robot that does not answer."""


class Crates(Fusion):
    """A fusion that finds one crate in each cloud: the middle of all that is above the floor."""

    def __init__(self, name: str) -> None:
        self.name = name

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        cloud = clean_points(points)
        return encode_points(cloud[cloud[:, 2] > -0.9], options.max_error_m)

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        return CrateClouds(transform(world_from_own, clean_points(own)))


class CrateClouds(Gathering):
    """Clouds in the world frame."""

    def __init__(self, own: Points) -> None:
        self.clouds = [own]

    def add(self, contribution: Contribution) -> None:
        points = decode_points(contribution.payload)
        self.clouds.append(transform(contribution.world_from_sensor, points))

    def finish(self) -> Boxes:
        middles = [c[c[:, 2] > 0.1].mean(axis=0) for c in self.clouds if (c[:, 2] > 0.1).any()]
        n = len(middles)
        centers = np.array(middles, dtype=np.float64).reshape(n, 3)
        return Boxes(centers, np.ones((n, 3)), np.zeros(n), np.ones(n), ("crate",) * n)


class Strays(Crates):
    """The same, but that nobody knows where R2 is."""

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        return _WithoutR2(transform(world_from_own, clean_points(own)))


class _WithoutR2(CrateClouds):
    def add(self, contribution: Contribution) -> None:
        if contribution.robot != "R2":
            super().add(contribution)

    def left_out(self) -> dict[str, str]:
        return {"R2": "R2 is somewhere"}


class Hall:
    """A world with a floor and one crate, 5 m in front of whoever looks."""

    name = "hall"
    robots: tuple[str, ...] = ("R1", "R2", "R3")
    rate_hz = 10.0
    frame_count = 1000
    range_m = 30.0
    detector = "factory"

    def __init__(self) -> None:
        floor = np.stack(np.meshgrid(np.arange(-9, 9, 0.3), np.arange(-9, 9, 0.3)), axis=-1)
        flat = np.column_stack([floor.reshape(-1, 2), np.full(floor[..., 0].size, -1.0)])
        self.points: Points = np.concatenate([flat, BOX * 0.5 + [5, 0, 0]]).astype(np.float32)
        self.readable = True

    def pose(self, robot: str, frame: int) -> Pose:
        return Pose(0.0, 10.0 * self.robots.index(robot), 1.0)

    def scan(self, robot: str, frame: int) -> Scan:
        if not self.readable:
            raise WorldError("scan cannot be read: the disk is gone")
        return Scan(robot, frame, self.points, self.pose(robot, frame), (0.0, 0.0, 0.0))

    def ground_truth(self, frame: int) -> GroundTruth:
        return GroundTruth(Boxes.empty(), (), np.zeros(0, np.int64))


class Ego:
    """The ego's executing half on a real session."""

    def __init__(
        self, session: Session, world: World, fusions: Mapping[str, Fusion] | None = None
    ) -> None:
        """`fusions`: by default those that find crates."""
        crates = fusions or {name: Crates(name) for name in ("early", "late")}
        self.epoch_ns = time.time_ns()
        settings = EgoSettings(deadline_s=DEADLINE_S, epoch_ns=self.epoch_ns)
        metrics, log = EgoMetrics(CollectorRegistry()), make_logger("test")
        agent = ego_of(settings, world, metrics, log, fusions=crates)
        self.monitor, self.loop = agent.monitor, agent.fusion
        self.tally, self.sensor, self.known = agent.tally, agent.sensor, agent.knowledge
        self.link = self.monitor.link
        self.monitor.attach(session)
        self.loop.connect(session)

    def own(self) -> OwnFrame:
        own = self.sensor.read(self.sensor.newest())
        assert own is not None
        return own

    def fuse(self, *others: str, algorithm: str = "early") -> FrameResult:
        return self.loop.fuse(decision(*others, algorithm=algorithm), self.own())


def decision(*others: str, algorithm: str = "early") -> Decision:
    return Decision(
        ego="R1",
        cycle=1,
        decided_ns=1,
        participants=("R1", *others),
        algorithm=algorithm,
        reason="",
        source="policy",
        policy="test",
        valid=True,
    )


@pytest.fixture(scope="module", name="swarm")
def a_swarm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Swarm]:
    with swarm_of({}, tmp_path_factory.mktemp("execute")) as swarm:
        swarm.router()
        yield swarm


@pytest.fixture(name="hall")
def a_hall() -> Hall:
    return Hall()


@pytest.fixture(name="ego")
def an_ego(swarm: Swarm, hall: Hall) -> Iterator[Ego]:
    with Session(swarm.address, "test", timeout_s=60) as session:
        yield Ego(session, hall)


Answer = Callable[[ObservationRequest], Observation]


@pytest.fixture(name="robot")
def a_robot(swarm: Swarm, ego: Ego) -> Iterator[Callable[[str, Answer], None]]:
    """Puts a robot into the swarm that answers as the test says."""
    sessions: list[Session] = []

    def start(name: str, answer: Answer) -> None:
        session = Session(swarm.address, "test", timeout_s=60)
        sessions.append(session)
        key = keyspace.observation("test", name)
        session.serve(key, ObservationRequest, answer, workers=OBSERVE_WORKERS, newest_first=True)
        session.declare_alive(name)
        until(lambda: ego.monitor.is_alive(name), f"{name} is seen")

    yield start
    for session in sessions:
        session.close()


def honest(hall: Hall, name: str) -> Answer:
    def answer(request: ObservationRequest) -> Observation:
        payload = Crates("").encode(hall.points, EncodeOptions(request.max_error_m))
        return observation(hall, name, request, payload)

    return answer


def observation(
    hall: World, name: str, asked: ObservationRequest, payload: bytes, **other: object
) -> Observation:
    fields = {
        "robot": name,
        "instance": 1,
        "request": asked.request,
        "algorithm": asked.algorithm,
        "capture_ns": asked.capture_ns,
        "frame": 0,
        "pose": hall.pose(name, 0).as_tuple(),
        "payload": payload,
        "encode_ms": 1.0,
    }
    return Observation(**{**fields, **other})  # type: ignore[arg-type]


RobotStarter = Callable[[str, Answer], None]
