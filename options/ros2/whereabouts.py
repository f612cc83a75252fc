"""Where a live robot's sensor is, by its odometry or by tf of the last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from options.ros.frames import (
    BASE,
    FIXED,
    Velocity,
    chain_down,
    mounted,
    plain,
    sensor_velocity,
)
from options.ros.messages import Odometry, Transform, read_odometry, read_transforms
from options.ros.track import Placed, Track
from options.ros2.address import Address
from options.ros2.samples import Decoded, Static, keep, odometry_stamp, stamped, transform_stamp
from options.ros2.topic_buffer import TopicBuffer
from swarm.errors import WorldError
from swarm.geometry import Matrix

MAX_FRAMES = 256
"""Moving frames that are remembered beside the robot's own: a tracker may name one for each thing
it sees, for ever."""
_ALWAYS_NS = 2**62
_DIFFERENCE_NS = 100_000_000
"""The time over which positions give a velocity."""


class Whereabouts(Protocol):
    """Where sensors are in the robot's fixed frame. Times are nanoseconds of the robot's stamps.

    Methods but `update` raise WorldError when what has come does not say it.
    """

    @property
    def fault(self) -> str:
        """What is wrong with the newest message of a topic; empty when nothing is."""
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


def find_whereabouts(address: Address, poses: TopicBuffer, static: TopicBuffer) -> Whereabouts:
    """What turns an address's poses (odometry or tf) and its transforms that stay into places."""
    return (_ByOdometry if address.odom else _ByTransforms)(address, poses, static)


class _ByOdometry:
    """By a pose and a twist of the robot's base."""

    def __init__(self, address: Address, poses: TopicBuffer, static: TopicBuffer) -> None:
        self._address = address
        self._poses = Decoded(poses, read_odometry)
        self._static = Static(static)
        self._kept: deque[Odometry] = deque()

    @property
    def fault(self) -> str:
        return self._poses.fault or self._static.fault

    def update(self) -> None:
        self._static.update()
        for message, one in self._poses.take():
            moved = stamped(one.transform, message)
            keep(self._kept, Odometry(moved, one.linear, one.angular), odometry_stamp)

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
    """By tf: a chain of frames from map, or else odom.

    Of a chain from map, `odom` in it is a localization's correction (REP-105): it jumps, comes when
    it comes and holds until the next one. What moves is interpolated, and ends when it falls
    silent. By times alone the two cannot be told apart: a correction that does not come is well,
    a robot whose odometry stopped is lost.
    """

    def __init__(self, address: Address, poses: TopicBuffer, static: TopicBuffer) -> None:
        self._address = address
        self._poses = Decoded(poses, read_transforms)
        self._static = Static(static)
        self._told: dict[str, deque[Transform]] = {}
        """What came on the tf topic, by child frame."""
        self._used: frozenset[str] = frozenset()
        """The frames of the last chain."""

    @property
    def fault(self) -> str:
        return self._poses.fault or self._static.fault

    def update(self) -> None:
        self._static.update()
        for message, found in self._poses.take():
            for one in found:
                kept = self._told.setdefault(one.child, deque())
                if kept and kept[-1].parent != one.parent:
                    kept.clear()
                keep(kept, stamped(one, message), transform_stamp)
        self._forget()

    def newest_ns(self, sensor: str) -> int | None:
        if not self._told and not self._static.under:
            return None
        moving = self._moving(self._chain(sensor))
        return min((self._told[frame][-1].stamp_ns for frame in moving), default=_ALWAYS_NS)

    def at(self, sensor: str, time_ns: int) -> Placed:
        return self._at(sensor, time_ns, corrected_ns=time_ns)

    def velocity(self, sensor: str, time_ns: int) -> Velocity:
        # By one correction: that it jumps is no motion.
        before = self._at(sensor, time_ns - _DIFFERENCE_NS, corrected_ns=time_ns)
        now = self._at(sensor, time_ns, corrected_ns=time_ns)
        x, y, z = (now.a_from_b - before.a_from_b)[:3, 3] * 1e9 / _DIFFERENCE_NS
        return (float(x), float(y), float(z))

    def _at(self, sensor: str, time_ns: int, *, corrected_ns: int) -> Placed:
        """`fixed_from_sensor` by the corrections that hold at `corrected_ns`."""
        chain = self._chain(sensor)
        moving = self._moving(chain)
        out, known = np.eye(4), True
        for frame in chain:
            if frame in moving:
                samples = self._told[frame]
                placed = Track(samples).at(time_ns)
                known = known and placed.known and time_ns >= samples[0].stamp_ns
            else:
                placed = Track([self._holding(frame, corrected_ns)]).at(time_ns)
            out = out @ placed.a_from_b
        mount = np.eye(4) if self._address.sensor is None else self._address.sensor.matrix()
        return Placed(out @ mount, known)

    def _moving(self, chain: Sequence[str]) -> list[str]:
        """The frames of a chain that must be told all the time: all that tf tells but corrections.

        Where nothing else moves, what would correct odometry is all that moves the robot.
        """
        told = [frame for frame in chain if frame in self._told]
        return [frame for frame in told if plain(frame) not in FIXED] or told

    def _holding(self, frame: str, time_ns: int) -> Transform:
        """What holds of a frame that is not interpolated: the newest by then, else the first."""
        told = self._told.get(frame)
        if told is None:
            return self._static.under[frame]
        before = [one for one in told if one.stamp_ns <= time_ns]
        return max(before, key=transform_stamp) if before else min(told, key=transform_stamp)

    def _forget(self) -> None:
        """Drops the frames told the longest ago, beyond `MAX_FRAMES` and the last chain's."""
        others = [frame for frame in self._told if frame not in self._used]
        if len(others) <= MAX_FRAMES:
            return
        others.sort(key=lambda frame: self._told[frame][-1].stamp_ns)
        for frame in others[:-MAX_FRAMES]:
            del self._told[frame]

    def _chain(self, sensor: str) -> list[str]:
        parents = {child: one.parent for child, one in self._static.under.items()}
        parents |= {child: kept[-1].parent for child, kept in self._told.items()}
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
        self._used = frozenset(chain)
        return chain
