"""Where a live robot's sensor is, by its odometry or by tf of the last seconds."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np

from ros2.address import Address
from ros2.inlet import Arrived, Inlet
from swarm.errors import WorldError
from swarm.geometry import Matrix
from worlds.ros.cdr import CdrError
from worlds.ros.frames import (
    BASE,
    FIXED,
    Velocity,
    chain_down,
    mounted,
    plain,
    sensor_velocity,
)
from worlds.ros.messages import Odometry, Transform, read_odometry, read_transforms
from worlds.ros.track import Placed, Track

KEEP_NS = 3_000_000_000
"""Poses older than this are forgotten: no scan waits longer for its own."""
SLOW_NS = 200_000_000
"""Transforms that come more rarely are corrections, which hold until the next one."""
_DIFFERENCE_NS = 100_000_000
"""The time over which positions give a velocity."""

T = TypeVar("T")


class Whereabouts(Protocol):
    """Where sensors are in the robot's fixed frame. Times are nanoseconds of the robot's stamps.

    Methods but `update` raise WorldError when what has come does not say it.
    """

    @property
    def fault(self) -> str:
        """What is wrong with the last message that could not be read; empty when none was."""
        ...

    def update(self) -> None:
        """Takes what has come."""
        ...

    def newest_ns(self, sensor: str) -> int | None:
        """Up to when the sensor's pose is known; None when nothing has come."""
        ...

    def at(self, sensor: str, time_ns: int) -> Placed:
        """`fixed_from_sensor`."""
        ...

    def velocity(self, sensor: str, time_ns: int) -> Velocity:
        """Of the sensor, m/s along the axes of the fixed frame."""
        ...


def find_whereabouts(address: Address, poses: Inlet, static: Inlet) -> Whereabouts:
    """What turns an address's poses (odometry or tf) and its transforms that stay into places."""
    return (_ByOdometry if address.odom else _ByTransforms)(address, poses, static)


class _Static:
    """Transforms that stay."""

    def __init__(self, inlet: Inlet) -> None:
        self.under: dict[str, Transform] = {}
        self.fault = ""
        self._inlet = inlet

    def update(self) -> None:
        for _, found in self.read(self._inlet, read_transforms):
            self.under |= {one.child: one for one in found}

    def read(self, inlet: Inlet, read: Callable[[bytes], T]) -> Iterator[tuple[Arrived, T]]:
        """What came on an inlet, but for messages that are malformed."""
        for message in inlet.take():
            try:
                yield message, read(message.payload)
            except (CdrError, struct.error) as error:
                self.fault = f"a message on {inlet.topic} is malformed: {error}"


class _ByOdometry:
    """By a pose and a twist of the robot's base."""

    def __init__(self, address: Address, poses: Inlet, static: Inlet) -> None:
        self._address = address
        self._inlet = poses
        self._static = _Static(static)
        self._kept: deque[Odometry] = deque()

    @property
    def fault(self) -> str:
        return self._static.fault

    def update(self) -> None:
        self._static.update()
        for message, one in self._static.read(self._inlet, read_odometry):
            moved = _stamped(one.transform, message)
            _keep(self._kept, Odometry(moved, one.linear, one.angular), _odometry_stamp)

    def newest_ns(self, sensor: str) -> int | None:
        return self._kept[-1].transform.stamp_ns if self._kept else None

    def at(self, sensor: str, time_ns: int) -> Placed:
        base = self._track().at(time_ns)
        known = base.known and time_ns >= self._kept[0].transform.stamp_ns
        return Placed(base.a_from_b @ self._mount(sensor), known)

    def velocity(self, sensor: str, time_ns: int) -> Velocity:
        near = min(self._kept, key=lambda one: abs(one.transform.stamp_ns - time_ns))
        return sensor_velocity(near, self._track().at(time_ns).a_from_b, self._mount(sensor))

    def _track(self) -> Track:
        return Track([one.transform for one in self._kept])

    def _mount(self, sensor: str) -> Matrix:
        if self._address.sensor is not None:
            return self._address.sensor.matrix()
        base = self._kept[-1].transform.child
        mount = mounted(self._static.under, base, sensor)
        if mount is None:
            raise WorldError(
                f"nothing says where {sensor!r}, the frame of {self._address.points}, is on "
                f"{base!r}, the frame of {self._address.odom}: {self._address.tf_static} leads "
                "from neither to the other; give sensor=x,y,z,roll,pitch,yaw in the address"
            )
        return mount


class _ByTransforms:
    """By tf: a chain of frames from map, or else odom."""

    def __init__(self, address: Address, poses: Inlet, static: Inlet) -> None:
        self._address = address
        self._inlet = poses
        self._static = _Static(static)
        self._moving: dict[str, deque[Transform]] = {}

    @property
    def fault(self) -> str:
        return self._static.fault

    def update(self) -> None:
        self._static.update()
        for message, found in self._static.read(self._inlet, read_transforms):
            for one in found:
                kept = self._moving.setdefault(one.child, deque())
                if kept and kept[-1].parent != one.parent:
                    kept.clear()
                _keep(kept, _stamped(one, message), _transform_stamp)

    def newest_ns(self, sensor: str) -> int | None:
        if not self._moving and not self._static.under:
            return None
        moving = [self._moving[frame] for frame in self._chain(sensor) if frame in self._moving]
        if not moving:
            return 2**62  # all of it stays where it is
        quick = [kept for kept in moving if _step_ns(kept) <= SLOW_NS]
        return min(kept[-1].stamp_ns for kept in quick or moving)

    def at(self, sensor: str, time_ns: int) -> Placed:
        out, known = np.eye(4), True
        for frame in self._chain(sensor):
            samples = self._moving.get(frame) or [self._static.under[frame]]
            placed = Track(samples).at(time_ns)
            early = time_ns < samples[0].stamp_ns and _step_ns(samples) <= SLOW_NS
            out, known = out @ placed.a_from_b, known and placed.known and not early
        mount = np.eye(4) if self._address.sensor is None else self._address.sensor.matrix()
        return Placed(out @ mount, known)

    def velocity(self, sensor: str, time_ns: int) -> Velocity:
        before, now = self.at(sensor, time_ns - _DIFFERENCE_NS), self.at(sensor, time_ns)
        x, y, z = (now.a_from_b - before.a_from_b)[:3, 3] * 1e9 / _DIFFERENCE_NS
        return (float(x), float(y), float(z))

    def _chain(self, sensor: str) -> list[str]:
        parents = {child: one.parent for child, one in self._static.under.items()}
        parents |= {child: kept[-1].parent for child, kept in self._moving.items()}
        target = sensor
        if self._address.sensor is not None:
            target = next((frame for frame in parents if plain(frame) == BASE), BASE)
        chain = chain_down(parents, target)
        if chain is None:
            edges = ", ".join(f"{parent} -> {child}" for child, parent in sorted(parents.items()))
            raise WorldError(
                f"{self._address.tf} leads from none of {', '.join(FIXED)} to {target!r}; it has "
                f"{edges or 'nothing'}"
            )
        return chain


def _odometry_stamp(one: Odometry) -> int:
    return one.transform.stamp_ns


def _transform_stamp(one: Transform) -> int:
    return one.stamp_ns


def _stamped(one: Transform, message: Arrived) -> Transform:
    """The transform with the time at which it holds."""
    return Transform(
        stamp_of(one.stamp_ns, message), one.parent, one.child, one.translation, one.rotation
    )


def stamp_of(header_ns: int, message: Arrived) -> int:
    """When a message's content holds: its header's stamp, else when it was published or came."""
    if header_ns or message.attachment is None:
        return header_ns or message.received_ns
    return message.attachment.published_ns


def _keep(kept: deque[T], one: T, stamp: Callable[[T], int]) -> None:
    """Adds the newest of samples in the order of their stamps, and drops what is old."""
    if kept and stamp(one) < stamp(kept[-1]) - KEEP_NS:
        kept.clear()  # the robot's time was set back
    kept.append(one)
    while len(kept) > 2 and stamp(kept[0]) < stamp(one) - KEEP_NS:
        kept.popleft()


def _step_ns(kept: Sequence[Transform]) -> float:
    """How far apart samples are; of a single one nobody knows."""
    spans = len(kept) - 1
    return (kept[-1].stamp_ns - kept[0].stamp_ns) / spans if spans else math.inf
