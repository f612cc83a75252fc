"""An ego on a site of cells, over a real router: who is near is heard, wherever the ego goes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec
import pytest

from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.monitor.surroundings import Surroundings
from swarm import keyspace
from swarm.areas import CELL_M, cell_of, name_of
from swarm.errors import TransportError
from swarm.listening import hear
from swarm.log import make_logger
from swarm.messages import Beacon, Message, SceneDescription
from swarm.session import Session
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import Inbox, RouterProcess, SessionMaker, until

RANGE_M = 45.0
FAR_M = 1_000.0
BEACON = next(one for one in SAMPLES if isinstance(one, Beacon))
SCENE = next(one for one in SAMPLES if isinstance(one, SceneDescription))


class Robots:
    """Robots that tell of themselves on one session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._seq = 0

    def tell(self, robot: str, x: float, y: float = 0.0, *, cells: bool = True) -> int:
        """A beacon and a scene; their number."""
        self._seq += 1
        for message, key in ((BEACON, keyspace.beacon), (SCENE, keyspace.scene)):
            self._tell(message, key, robot, (x, y), cells)
        return self._seq

    def _tell(
        self,
        message: Message,
        key: Callable[[str, str], str],
        robot: str,
        place: tuple[float, float],
        cells: bool,
    ) -> None:
        told = msgspec.structs.replace(
            message, robot=robot, seq=self._seq, pose=(*place, 1.5, 0.0, 0.0, 0.0)
        )
        where = key(self._session.swarm, robot)
        if cells:
            where = keyspace.within(where, name_of(cell_of(*place)))
        self._session.put(where, told)


class Ego:
    """An ego's ears, and what came to them."""

    def __init__(self, session: Session) -> None:
        self.heard: Inbox[tuple[str, str, int]] = Inbox()
        self.robots: set[str] = set()
        self.around = Surroundings(RANGE_M, RANGE_M, make_logger("test"))
        self.around.attach(
            session,
            {
                Beacon: lambda one: self._hear("beacon", one),
                SceneDescription: lambda one: self._hear("scene", one),
            },
        )

    def _hear(self, kind: str, told: Beacon | SceneDescription) -> None:
        self.robots.add(told.robot)
        self.heard.put((kind, told.robot, told.seq))

    def goes(self, x: float, y: float = 0.0) -> None:
        """Drives or jumps there, and listens there."""
        self.around.moved(x, y)
        until(lambda: self.around.cells >= self.around.around(x, y), "the cells are listened to")

    def hears(self, robots: Robots, robot: str, x: float, *, cells: bool = True) -> None:
        """Waits for a robot that tells again and again: a router may not know yet who listens, and
        a busy machine drops single beacons."""

        def came() -> bool:
            told = robots.tell(robot, x, cells=cells)
            self.heard.next_where(lambda got: got == ("beacon", robot, told), 0.2)
            return True

        until(lambda: _quietly(came), f"{robot} at {x} m is heard")


def _quietly(attempt: Callable[[], bool]) -> bool:
    try:
        return attempt()
    except Exception:  # queue.Empty: not yet
        return False


@pytest.fixture
def site(shared_router: RouterProcess, open_session: SessionMaker) -> Iterator[tuple[Robots, Ego]]:
    robots = Robots(open_session(shared_router.address))
    ego = Ego(open_session(shared_router.address))
    yield robots, ego
    ego.around.close()


def test_who_is_near_is_heard_and_who_is_far_is_not(site: tuple[Robots, Ego]) -> None:
    robots, ego = site
    ego.goes(0.0)
    for place in (30.0, -30.0):
        robots.tell("R9", FAR_M)
        ego.hears(robots, "R2", place)
    assert ego.robots == {"R2"}


def test_who_does_not_say_where_is_heard_from_everywhere(site: tuple[Robots, Ego]) -> None:
    robots, ego = site
    ego.hears(robots, "R5", FAR_M, cells=False)
    ego.goes(0.0)
    ego.hears(robots, "R5", FAR_M, cells=False)


def test_no_beacon_is_missing_of_a_robot_that_crosses_cells(site: tuple[Robots, Ego]) -> None:
    robots, ego = site
    ego.goes(0.0)
    for step in range(-40, 41):
        assert (Beacon, cell_of(step, 0.0)) in ego.around.cells
        ego.hears(robots, "R2", float(step))


def test_an_ego_that_drives_keeps_hearing_a_robot_beside_it(site: tuple[Robots, Ego]) -> None:
    robots, ego = site
    ego.goes(0.0)
    ego.hears(robots, "R2", 5.0)
    for step in range(0, int(4 * CELL_M), 2):
        ego.goes(float(step))
        assert (Beacon, cell_of(step + 5.0, 0.0)) in ego.around.cells
        ego.hears(robots, "R2", step + 5.0)


def test_an_ego_that_jumps_hears_who_is_there_and_leaves_the_rest(
    site: tuple[Robots, Ego],
) -> None:
    robots, ego = site
    ego.goes(0.0)
    ego.hears(robots, "R2", 10.0)
    ego.goes(FAR_M)
    ego.hears(robots, "R9", FAR_M + 10.0)
    until(
        lambda: not ego.around.cells & ego.around.around(0.0, 0.0), "the old cells are left alone"
    )


def test_an_ego_goes_on_where_its_session_could_not_listen(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    session = open_session(shared_router.address)
    subscribe, fails = session.subscribe, [TransportError("no session")] * 3

    def sometimes(*args: object) -> object:
        if fails:
            raise fails.pop()
        return subscribe(*args)  # type: ignore[arg-type]

    around = Surroundings(RANGE_M, RANGE_M, make_logger("test"))
    around.attach(session, {Beacon: lambda _: None, SceneDescription: lambda _: None})
    session.subscribe = sometimes  # type: ignore[method-assign, assignment]
    around.moved(0.0, 0.0)
    until(lambda: around.cells >= around.around(0.0, 0.0), "the cells are listened to")
    around.close()


def test_who_listens_to_all_hears_robots_in_cells(
    shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    robots, heard = Robots(open_session(shared_router.address)), set[str]()
    hear(open_session(shared_router.address), {Beacon: lambda one: heard.add(one.robot)})
    monitor = Monitor("E", LinkEstimate(55e6))
    monitor.attach(open_session(shared_router.address))

    def both() -> bool:
        robots.tell("R2", FAR_M)
        robots.tell("R3", 0.0, cells=False)
        return {"R2", "R3"} <= heard & set(monitor.snapshot(1, 0).robots)

    until(both, "both robots are heard")
