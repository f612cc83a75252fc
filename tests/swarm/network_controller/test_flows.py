"""Telemetry flows on behalf of operators: real processes on the loopback interface."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping
from typing import cast

import pytest

from network_controller.drivers.base import Driver, Running
from network_controller.telemetry.flows import Flows
from swarm.errors import LinkGoneError, NetworkError
from tests.support.zenoh_fixtures import until

WAIT_S = 30.0
RATE_BPS = 1_000_000


class LocalDriver:
    """Robots whose network namespace is this one."""

    def __init__(self) -> None:
        self.sinks: list[subprocess.Popen[bytes]] = []

    def robots(self) -> Mapping[str, str]:
        return {"R1": "127.0.0.1", "R2": "127.0.0.1"}

    def start_at(self, robot: str, argv: list[str]) -> Running:
        self.sinks.append(subprocess.Popen(argv, stdout=subprocess.PIPE))
        return self.sinks[-1]


class Afar:
    """A program that can be asked, but not ended from here: like one in a container."""

    def __init__(self, process: Running) -> None:
        self._process = process

    def poll(self) -> int | None:
        return self._process.poll()


class FarDriver(LocalDriver):
    def start_at(self, robot: str, argv: list[str]) -> Running:
        return Afar(super().start_at(robot, argv))


class Lost:
    """A program whose container nobody can ask any more."""

    def poll(self) -> int | None:
        raise NetworkError("no such container")


class LosingDriver(LocalDriver):
    def start_at(self, robot: str, argv: list[str]) -> Running:
        return Lost()


class FullDriver(LocalDriver):
    """Starts the first program only."""

    def start_at(self, robot: str, argv: list[str]) -> Running:
        if self.sinks:
            raise NetworkError("no room")
        return super().start_at(robot, argv)


@pytest.fixture
def driver() -> Iterator[LocalDriver]:
    yield from cleared(LocalDriver())


def cleared(driver: LocalDriver) -> Iterator[LocalDriver]:
    yield driver
    for sink in driver.sinks:
        with sink:
            sink.kill()


def received(sink: subprocess.Popen[bytes]) -> dict[str, int]:
    """What a sink has counted, once it has ended by itself."""
    out, _ = sink.communicate(timeout=WAIT_S)
    counts: dict[str, int] = json.loads(out.splitlines()[-1])
    return counts


@pytest.fixture
def flows(driver: LocalDriver) -> Iterator[Flows]:
    flows = Flows(cast(Driver, driver))
    yield flows
    flows.close()


def test_flows_of_the_chosen_protocol_arrive_and_end_by_themselves(
    flows: Flows, driver: LocalDriver
) -> None:
    flows.start("R1", RATE_BPS, 3.0)
    flows.start("R2", RATE_BPS, 3.0, "udp")
    assert list(flows.running()) == ["R1", "R2"]
    until(lambda: not flows.running(), "the flows have ended", WAIT_S)
    both, udp = (received(sink) for sink in driver.sinks)
    assert both["udp"] > 0
    assert both["tcp"] > 0
    assert udp["udp"] > 0
    assert udp["tcp"] == 0


def test_a_new_flow_replaces_the_one_to_the_same_robot(flows: Flows, driver: LocalDriver) -> None:
    flows.start("R1", RATE_BPS, 600.0)
    flows.start("R2", RATE_BPS, 600.0)
    before = flows.running()
    flows.start("R1", RATE_BPS, 1200.0)
    now = flows.running()
    assert sorted(now) == ["R1", "R2"]
    assert now["R1"] > before["R1"]
    assert now["R2"] == before["R2"]
    assert [sink.poll() is None for sink in driver.sinks] == [False, True, True]


def test_a_flow_can_be_stopped_and_the_others_go_on(flows: Flows, driver: LocalDriver) -> None:
    flows.start("R1", RATE_BPS, 600.0)
    flows.start("R2", RATE_BPS, 600.0)
    flows.stop("R1")
    flows.stop("R1")
    assert list(flows.running()) == ["R2"]
    assert [sink.poll() is None for sink in driver.sinks] == [False, True]
    flows.stop()
    assert not flows.running()
    assert all(sink.poll() is not None for sink in driver.sinks)


@pytest.mark.parametrize(
    ("rate_bps", "seconds", "told"),
    [
        (0, 10.0, "telemetry of 0 bit/s"),
        (999, 10.0, "allowed are 1000 to 1000000000"),
        (1_000_000_001, 10.0, "telemetry of 1000000001 bit/s"),
        (RATE_BPS, 0.0, "telemetry for 0 s"),
        (RATE_BPS, 3600.5, "allowed is up to 3600 s"),
        (RATE_BPS, float("nan"), "telemetry for nan s"),
    ],
)
def test_a_flow_without_reasonable_bounds_is_refused(
    rate_bps: int, seconds: float, told: str, flows: Flows, driver: LocalDriver
) -> None:
    with pytest.raises(NetworkError, match=told):
        flows.start("R1", rate_bps, seconds)
    assert not driver.sinks
    assert not flows.running()


def test_a_robot_that_is_not_here_is_refused(flows: Flows, driver: LocalDriver) -> None:
    with pytest.raises(LinkGoneError, match="'R9' has no link"):
        flows.start("R9", RATE_BPS, 10.0)
    assert not driver.sinks


def test_a_flow_that_cannot_be_replaced_goes_on() -> None:
    for driver in cleared(FullDriver()):
        flows = Flows(cast(Driver, driver))
        flows.start("R1", RATE_BPS, 600.0)
        before = flows.running()
        with pytest.raises(NetworkError, match="no room"):
            flows.start("R1", RATE_BPS, 10.0)
        assert flows.running() == before
        flows.close()


def test_a_flow_whose_sink_cannot_be_ended_from_here_is_stopped_at_its_source() -> None:
    for driver in cleared(FarDriver()):
        flows = Flows(cast(Driver, driver))
        flows.start("R1", RATE_BPS, 600.0)
        flows.stop("R1")
        assert not flows.running()
        assert driver.sinks[0].poll() is None


def test_a_sink_that_cannot_be_asked_any_more_is_forgotten() -> None:
    flows = Flows(cast(Driver, LosingDriver()))
    flows.start("R1", RATE_BPS, 0.2)
    until(lambda: not flows.running(), "the flow has ended", WAIT_S)
    flows.close()
