"""Telemetry flows towards robots, started and ended on behalf of operators."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Mapping
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


@dataclass(frozen=True, slots=True)
class _Flow:
    source: subprocess.Popen[bytes]
    sink: Running
    until_s: float


class Flows:
    """At most one flow a robot; every flow ends by itself. Used under the controller's lock."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._flows: dict[str, _Flow] = {}
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
        self.stop(robot)
        module = "network_controller.telemetry"
        port = str(FIRST_PORT + self._started % PORTS)
        self._started += 1
        argv = [sys.executable, "-m", f"{module}.sink", "--port", port]
        sink = self._driver.start_at(robot, [*argv, "--seconds", str(seconds + SINK_EXTRA_S)])
        source = subprocess.Popen(
            [
                *(sys.executable, "-m", f"{module}.source", "--to", address, "--port", port),
                *("--rate-bps", str(rate_bps), "--seconds", str(seconds), "--protocol", protocol),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        self._flows[robot] = _Flow(source, sink, time.monotonic() + seconds)

    def running(self) -> Mapping[str, float]:
        """When each flow ends, `time.monotonic()` seconds, by robot."""
        for flow in self._flows.values():
            flow.sink.poll()
        self._flows = {r: flow for r, flow in self._flows.items() if flow.source.poll() is None}
        return {robot: flow.until_s for robot, flow in self._flows.items()}

    def stop(self, robot: str | None = None) -> None:
        """Ends the flow towards a robot, or all flows."""
        for name in [robot] if robot is not None else list(self._flows):
            flow = self._flows.pop(name, None)
            if flow is None or flow.source.poll() is not None:
                continue
            flow.source.terminate()
            try:
                flow.source.wait(STOP_S)
            except subprocess.TimeoutExpired:
                flow.source.kill()
                flow.source.wait()

    def close(self) -> None:
        """Ends all flows."""
        self.stop()
