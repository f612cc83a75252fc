"""What every process of a swarm shares: common settings, and a stop event set by signals."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from typing import Annotated, Literal, NoReturn

import msgspec

from swarm.defaults import ROUTER_PORT, SWARM
from swarm.messages.base import Algorithm
from swarm.settings import Name, Port

_NS = 1_000_000_000


class SwarmSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings that all processes of one swarm have in common."""

    swarm: Name = SWARM
    router: str = f"tcp/127.0.0.1:{ROUTER_PORT}"
    metrics_host: str = "127.0.0.1"
    metrics_port: Port = 9100
    metrics_address: Annotated[
        str,
        msgspec.Meta(
            pattern=r"^(([A-Za-z0-9._-]{1,253}|\[[0-9a-fA-F:]{2,45}\])(:[0-9]{1,5})?)?(?!\n)$",
            description="HOST, HOST:PORT or empty",
        ),
    ] = ""
    """Where others reach the metrics, as Prometheus is told; empty: at the address by which this
    process reaches the router."""
    metrics_tls: bool = False
    """Whether metrics are served over TLS, with the certificate that this process shows the router.
    """
    log_level: Literal["debug", "info", "warning", "error"] = "info"


Seed = Annotated[int, msgspec.Meta(ge=0)]
Rings = Literal[16, 32, 64]
PoseError = Annotated[float, msgspec.Meta(ge=0, le=10, description="0 to 10 m")]
Algorithms = Annotated[tuple[Algorithm, ...], msgspec.Meta(min_length=1, max_length=16)]


class ProcessSettings(SwarmSettings, frozen=True, kw_only=True):
    """Settings of the processes that live in a world."""

    world: Annotated[str, msgspec.Meta(min_length=1, max_length=64)] = "factory"
    """One of `worlds.registry.world_kinds()`."""
    world_data: str = ""
    """What the world needs: recorded data (a directory or a file), or a live robot's address."""
    world_robots: Annotated[int, msgspec.Meta(ge=2, le=1000)] = 6
    world_seed: Seed = 1
    world_rings: Rings = 32
    world_scenario: str = "floor"
    world_cache: str = ""
    """Directory for simulated or parsed scans; empty keeps none."""
    pose_error_m: PoseError = 0.0
    """By how much robots err about where they are: standard deviation in metres, and of the heading
    in degrees; from one error to another in five seconds at 10 Hz."""
    epoch_ns: Annotated[int, msgspec.Meta(ge=0)] = 0
    """When frame 0 was captured, nanoseconds since the Unix epoch; one value for the swarm."""


def frame_now(epoch_ns: int, rate_hz: float, now_ns: int) -> int:
    """The newest frame captured at or before `now_ns`; 0 before the epoch."""
    # In whole numbers: today's nanoseconds do not fit a float.
    frames, seconds = float(rate_hz).as_integer_ratio()
    return max(0, (now_ns - epoch_ns) * frames // (seconds * _NS))


def capture_ns(epoch_ns: int, rate_hz: float, frame: int) -> int:
    """When a frame is captured, nanoseconds since the Unix epoch (rounded up)."""
    frames, seconds = float(rate_hz).as_integer_ratio()
    return epoch_ns - (-frame * seconds * _NS // frames)


def stop_on_signals() -> threading.Event:
    """An event that SIGTERM and SIGINT set. Call it once, on the main thread.

    Python's own handlers run on the main thread only, which a signal that the kernel gives to one
    of Zenoh's threads does not wake; the wake-up descriptor is written on whichever thread it is.
    """
    stop = threading.Event()
    numbers = (signal.SIGTERM, signal.SIGINT)
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def watch() -> None:
        # Keeps the writer open as long as the process lives.
        while writer.fileno() >= 0 and (woken := reader.recv(1)):
            if woken[0] in numbers:
                stop.set()

    threading.Thread(target=watch, name="signals", daemon=True).start()
    for number in numbers:
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    return stop


def leave(code: int) -> NoReturn:
    """Ends the process at once with an exit code.

    Zenoh calls back on threads that Python waits for at exit, so that a session that could not
    close (its router is away) would keep the process alive.
    """
    for stream in (sys.stdout, sys.stderr):
        # A full disk below them does not change how the process ended.
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


class Clock:
    """The time of day of one process, which a test may put off.

    `offset_s` shifts this process's clock, as a robot's bad clock would be.
    """

    def __init__(self, offset_s: float = 0.0) -> None:
        self._offset_ns = round(offset_s * 1e9)

    @property
    def offset_ns(self) -> int:
        """How far this clock is ahead of the machine's."""
        return self._offset_ns

    def now_ns(self) -> int:
        """Nanoseconds since the Unix epoch on this process's clock."""
        return time.time_ns() + self._offset_ns
