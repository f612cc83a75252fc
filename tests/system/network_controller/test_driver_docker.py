"""Links of real containers, shaped from the host."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from deploy.docker.image import PUBLIC_BASE, ensure_image
from deploy.runtimes.docker import DockerRuntime
from network_controller import ladder
from network_controller.drivers import shaping
from network_controller.drivers.docker import LABEL, SERVICE_LABEL, DockerDriver
from network_controller.drivers.ifbs import ifb_of
from network_controller.model import DIRECTIONS, Link
from swarm.errors import LinkGoneError, NetworkError
from swarm.traffic import TrafficClass
from tests.support.deploy_support import await_

SWARM = f"drv{os.getpid()}"
RATE = 50_000_000
SIZE = 200_000
# Where no image is left of an earlier run, one is built.
pytestmark = pytest.mark.timeout(900)
_RECEIVE = (
    "import socket; s = socket.create_server(('', 5900)); print('ready', flush=True)\n"
    "while True:\n p, _ = s.accept(); n = 0\n"
    " while d := p.recv(65536): n += len(d)\n"
    " p.sendall(str(n).encode()); p.close()"
)
_SEND = (
    "import socket, sys; s = socket.socket(); s.setsockopt(0, 1, int(sys.argv[2]));"
    "s.connect((sys.argv[1], 5900)); s.sendall(bytes(int(sys.argv[3]))); s.shutdown(1);"
    "print(s.recv(64).decode())"
)


def image() -> str:
    """Any image with Python: what the tests run in it needs nothing of the project."""
    import docker

    tags = [tag for one in docker.from_env().images.list() for tag in one.tags]
    ours = re.compile(rf"coadapt-(base|edge):|{re.escape(PUBLIC_BASE)}$")
    return next(filter(ours.match, sorted(tags)), "") or ensure_image(lambda text: None)


class Yard:
    """Containers of one swarm on a network of their own."""

    def __init__(self) -> None:
        import docker

        self.engine = docker.from_env(timeout=60)
        self.image = image()
        self.network: Any = self.engine.networks.create(SWARM, labels={LABEL: SWARM})
        self.containers: dict[str, Any] = {}

    def add(self, service: str, *command: str, network: str = SWARM) -> Any:
        """A container that runs a command, else sleeps."""
        made = self.engine.containers.run(
            self.image,
            list(command) or ["sleep", "600"],
            detach=True,
            init=True,
            network=network,
            labels={LABEL: SWARM, SERVICE_LABEL: service},
        )
        self.containers[service] = made
        return made

    def remove(self, service: str) -> None:
        """Removes a container."""
        self.containers.pop(service).remove(force=True)

    def close(self) -> None:
        """Removes everything."""
        for service in list(self.containers):
            with contextlib.suppress(Exception):
                self.remove(service)
        self.network.remove()
        self.engine.close()


@pytest.fixture(scope="module")
def yard() -> Iterator[Yard]:
    why_not = DockerRuntime().available()
    if why_not is not None:
        pytest.skip(why_not)
    if os.geteuid() != 0 or shutil.which("tc") is None:
        pytest.skip("shaping the host's ends of containers' links needs root and tc")
    made = Yard()
    try:
        made.add("robot-R1", "python3", "-c", _RECEIVE)
        made.add("robot-R2", "python3", "-c", _RECEIVE)
        made.add("router")
        for service in ("robot-R1", "robot-R2"):
            await_(lambda s=service: made.containers[s].logs(), "the container listens")  # type: ignore[misc]
        yield made
    finally:
        made.close()


@pytest.fixture
def driver(yard: Yard) -> Iterator[DockerDriver]:
    made = DockerDriver(SWARM)
    yield made
    for link in made.shaped():
        made.clear(link)
    made.close()


def unlinked() -> list[str]:
    """The queues of this host's interfaces that are no container's."""
    shown = subprocess.run(["tc", "qdisc"], capture_output=True, text=True, check=True).stdout
    return [line for line in shown.splitlines() if not re.search(r"dev (veth|ifb-|br-)", line)]


def send(yard: Yard, source: str, to: str, traffic: TrafficClass) -> None:
    """Sends SIZE bytes from one container to an address, and waits until they are there."""
    argv = ["python3", "-c", _SEND, to, str(traffic.tos), str(SIZE)]
    code, out = yard.containers[source].exec_run(argv)
    assert (code, out.strip()) == (0, str(SIZE).encode())


def test_robots_are_the_containers_that_carry_the_swarms_label(
    yard: Yard, driver: DockerDriver
) -> None:
    found = driver.robots()
    assert set(found) == {"R1", "R2"}
    yard.containers["robot-R1"].reload()
    networks = yard.containers["robot-R1"].attrs["NetworkSettings"]["Networks"]
    assert found["R1"] == networks[SWARM]["IPAddress"]
    assert DockerDriver("another").robots() == {}


def test_traffic_of_a_container_goes_through_the_class_of_its_mark_both_ways(
    yard: Yard, driver: DockerDriver
) -> None:
    addresses = driver.robots()
    links = {way: Link("R1", way) for way in DIRECTIONS}
    for link in links.values():
        driver.apply(link, ladder.shape(RATE, 0))
    send(yard, "robot-R2", addresses["R1"], TrafficClass.FUSION)
    send(yard, "robot-R1", addresses["R2"], TrafficClass.CONTROL)
    readings = driver.read(list(links.values()))
    down, up = readings[links["down"]].classes, readings[links["up"]].classes
    assert down[TrafficClass.FUSION].sent_bytes > SIZE > down[TrafficClass.CONTROL].sent_bytes
    assert up[TrafficClass.CONTROL].sent_bytes > SIZE > up[TrafficClass.FUSION].sent_bytes


def test_links_that_share_a_medium_have_one_tree(yard: Yard, driver: DockerDriver) -> None:
    addresses = driver.robots()
    both = [Link("R1", "down"), Link("R2", "down")]
    for link in both:
        driver.apply(link, ladder.shape(RATE // 2, 0, ceil_bps=RATE, cell_bps=RATE))
    send(yard, "router", addresses["R2"], TrafficClass.FUSION)
    readings = driver.read(both)
    (tree,) = {reading.queue.device for reading in readings.values()}
    sent = [readings[link].classes[TrafficClass.FUSION].sent_bytes for link in both]
    assert sent[1] > SIZE > sent[0]
    for link in both:
        assert tree in {name for _, name in socket.if_nameindex()}
        driver.clear(link)
    assert tree not in {name for _, name in socket.if_nameindex()}
    assert not driver.shaped()


def test_a_new_driver_adopts_what_is_shaped_and_clearing_may_be_repeated(
    yard: Yard, driver: DockerDriver
) -> None:
    links = frozenset({Link("R1", "up"), Link("R2", "down")})
    for link in links:
        driver.apply(link, ladder.shape(RATE, 1))
    later = DockerDriver(SWARM)
    assert later.shaped() == links
    for _ in range(2):
        for link in links:
            later.clear(link)
    assert not driver.shaped()
    later.close()


def test_a_container_that_was_restarted_is_shaped_at_its_new_interface(
    yard: Yard, driver: DockerDriver
) -> None:
    both = [Link("R2", way) for way in DIRECTIONS]
    for link in both:
        driver.apply(link, ladder.shape(RATE, 0))
    yard.containers["robot-R2"].restart(timeout=1)
    await_(lambda: "R2" in driver.robots(), "the container has a link again")
    assert not driver.read(both)
    for link in both:
        driver.apply(link, ladder.shape(RATE, 0))
    assert set(driver.read(both)) == set(both)


def device_of(yard: Yard, service: str) -> str:
    """The host's end of a container's link."""
    _, index = yard.containers[service].exec_run(["cat", "/sys/class/net/eth0/iflink"])
    return socket.if_indextoname(int(index))


def test_the_egos_container_goes_before_its_robots(yard: Yard, driver: DockerDriver) -> None:
    robot = driver.robots()["R1"]
    both = [Link("R1", way) for way in DIRECTIONS]
    for link in both:
        driver.apply(link, ladder.shape(RATE, 0))
    places = [(device_of(yard, "robot-R1"), way) for way in DIRECTIONS]
    assert len(shaping.read(places)) == 2
    yard.add("ego-R1")
    try:
        await_(lambda: driver.robots().get("R1") not in (None, robot), "the ego's link")
        assert not driver.read(both)
        assert not shaping.read(places), "the robot's own link is let go"
        yard.containers["ego-R1"].stop(timeout=1)
        assert "R1" not in driver.robots(), "a link does not wander while its container is down"
    finally:
        yard.remove("ego-R1")
    assert driver.robots()["R1"] == robot


def test_a_container_on_a_network_that_is_not_the_swarms_is_left_alone(
    yard: Yard, driver: DockerDriver
) -> None:
    name = f"{SWARM}-other"
    other = yard.engine.networks.create(name)
    try:
        yard.add("robot-R7", network=name)
        assert "R7" not in driver.robots()
        with pytest.raises(NetworkError, match=f"network {name} .* is not the swarm's"):
            driver.apply(Link("R7", "down"), ladder.shape(RATE, 0))
    finally:
        yard.remove("robot-R7")
        other.remove()


def test_containers_that_are_gone_are_said_to_be(yard: Yard, driver: DockerDriver) -> None:
    yard.add("robot-R9")
    link = Link("R9", "up")
    queue = ifb_of(device_of(yard, "robot-R9"))
    driver.apply(link, ladder.shape(RATE, 0))
    assert queue in {name for _, name in socket.if_nameindex()}
    yard.remove("robot-R9")
    assert link not in driver.read([link])
    with pytest.raises(LinkGoneError, match="'R9' has no running container"):
        driver.apply(link, ladder.shape(RATE, 0))
    assert queue not in {name for _, name in socket.if_nameindex()}
    driver.clear(link)


def test_a_container_in_the_hosts_network_has_no_link_to_shape(
    yard: Yard, driver: DockerDriver
) -> None:
    before = unlinked()
    yard.add("robot-R8", network="host")
    try:
        assert "R8" not in driver.robots()
        with pytest.raises(NetworkError, match="R8"):
            driver.apply(Link("R8", "down"), ladder.shape(RATE, 0))
    finally:
        yard.remove("robot-R8")
    assert unlinked() == before


def test_a_controller_that_is_not_in_the_hosts_network_touches_nothing(yard: Yard) -> None:
    program = (
        "from network_controller import ladder\n"
        "from network_controller.drivers.docker import DockerDriver\n"
        "from network_controller.model import Link\n"
        "from swarm.errors import NetworkError\n"
        f"driver = DockerDriver({SWARM!r})\n"
        "assert driver.robots() == {}\n"
        "try:\n driver.apply(Link('R1', 'down'), ladder.shape(10**6, 0))\n"
        "except NetworkError as error:\n print(error)\n"
    )
    done = subprocess.run(
        ["unshare", "--net", sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "is not on bridge" in done.stdout, done.stderr
    assert "in the host's network namespace" in done.stdout


def test_programs_run_in_the_robots_container(yard: Yard, driver: DockerDriver) -> None:
    running = driver.start_at("R1", ["python3", "-c", "import sys; sys.exit(3)"])
    assert await_(lambda: running.poll() is not None, "the program has ended")
    assert running.poll() == 3
    with pytest.raises(LinkGoneError, match="nobody"):
        driver.start_at("nobody", ["true"])


def test_no_engine_is_said_in_clear_words(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("docker")
    monkeypatch.setenv("DOCKER_HOST", "tcp://127.0.0.1:1")
    driver = DockerDriver(SWARM)
    with pytest.raises(NetworkError, match="no Docker engine answers"):
        driver.robots()
    driver.close()
