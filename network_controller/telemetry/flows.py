"""Telemetry flows towards robots, started and ended on behalf of operators."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from network_controller.drivers.base import Driver, Running
from swarm.errors import LinkGoneError, NetworkError

FIRST_PORT, PORTS = 9110, 100
"""Where the sinks listen in the robots' namespaces: each on the next one, since an earlier sink may
still be there."""
MIN_RATE_BPS, MAX_RATE_BPS = 1_000, 1_000_000_000
MAX_SECONDS = 3600.0
SINK_EXTRA_S = 2.0
STOP_S = 2.0
_MODULE = "network_controller.telemetry"


@dataclass(frozen=True, slots=True)
class _Flow:
    source: subprocess.Popen[bytes]
    sink: Running
    until_s: float


class Flows:
    """At most one flow a robot; every flow ends by itself, and when this process ends. Used under
    the controller's lock."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._flows: dict[str, _Flow] = {}
        self._ending: list[Running] = []
        """Sinks that outlive their sources a little."""
        self._started = 0

    def start(
        self,
        robot: str,
        rate_bps: int,
        seconds: float,
        protocol: Literal["udp", "tcp", "both"] = "both",
    ) -> None:
        """Sends telemetry towards a robot; a flow that runs there already is replaced.

        Raises NetworkError for a rate or a time out of range, LinkGoneError for a robot that is
        not there.
        """
        if not MIN_RATE_BPS <= rate_bps <= MAX_RATE_BPS:
            raise NetworkError(
                f"telemetry of {rate_bps} bit/s cannot be made; allowed are {MIN_RATE_BPS} to "
                f"{MAX_RATE_BPS}"
            )
        if not 0.0 < seconds <= MAX_SECONDS:
            raise NetworkError(
                f"telemetry for {seconds:g} s cannot be made; allowed is up to {MAX_SECONDS:g} s"
            )
        address = self._driver.robots().get(robot)
        if address is None:
            raise LinkGoneError(f"robot {robot!r} has no link on this host")
        port = str(FIRST_PORT + self._started % PORTS)
        self._started += 1
        argv = [sys.executable, "-m", f"{_MODULE}.sink", "--port", port]
        sink = self._driver.start_at(robot, [*argv, "--seconds", str(seconds + SINK_EXTRA_S)])
        self.stop(robot)
        try:
            source = subprocess.Popen(
                [
                    *(sys.executable, "-m", f"{_MODULE}.source", "--to", address, "--port", port),
                    *("--rate-bps", str(rate_bps), "--seconds", str(seconds)),
                    *("--protocol", protocol, "--parent", str(os.getpid())),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        except OSError as error:
            _end(sink)
            raise NetworkError(f"telemetry towards {robot} cannot be started: {error}") from error
        self._flows[robot] = _Flow(source, sink, time.monotonic() + seconds)

    def running(self) -> Mapping[str, float]:
        """When each flow ends, `time.monotonic()` seconds, by robot."""
        for robot, flow in list(self._flows.items()):
            if flow.source.poll() is not None:
                self._ending.append(self._flows.pop(robot).sink)
        self._ending = [sink for sink in self._ending if _runs(sink)]
        return {robot: flow.until_s for robot, flow in self._flows.items()}

    def stop(self, robot: str | None = None) -> None:
        """Ends the flow towards a robot, or all flows."""
        for name in [robot] if robot is not None else list(self._flows):
            flow = self._flows.pop(name, None)
            if flow is not None:
                _terminate(flow.source)
                _end(flow.sink)

    def close(self) -> None:
        """Ends all flows."""
        self.stop()
        for sink in self._ending:
            _end(sink)
        self._ending = []


def _end(sink: Running) -> None:
    """Ends a sink at once where it is a child of this process. Another one ends by itself soon
    after nothing comes any more."""
    if isinstance(sink, subprocess.Popen):
        _terminate(sink)


def _runs(sink: Running) -> bool:
    """Whether a sink runs; asking also lets a child that has ended go."""
    with suppress(NetworkError):
        return sink.poll() is None
    return False


def _terminate(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
