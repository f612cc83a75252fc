"""Where a robot's sensor is over time, from its odometry or from tf."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Iterator
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from options.bags.recording import Messages, Recording
from options.bags.settings import RobotSettings
from options.ros.frames import (
    BASE,
    FIXED,
    Velocity,
    chain_down,
    mounted,
    plain,
    sensor_velocity,
)
from options.ros.messages import (
    ODOMETRY,
    STAMP_BYTES,
    TRANSFORMS,
    Odometry,
    Transform,
    read_odometry,
    read_stamp,
    read_transforms,
)
from options.ros.track import Placed, Track
from swarm.errors import WorldError
from swarm.geometry import Matrix
from worlds.world_file import FILE_NAME

_LOOK_NS = 5_000_000_000
"""So far into a bag a better fixed frame is looked for."""
_DIFFERENCE_NS = 50_000_000
"""Half of the time over which positions give a velocity."""


_ENDS = 50
"""Messages at each end of a topic among which the first and last stamp are looked for."""


class Motion(Protocol):
    """A sensor's way in its robot's fixed frame."""

    span_ns: tuple[int, int] | None
    """The first and last stamp; None for what never moves."""
    lags_s: NDArray[np.float64]
    """(N,): from a stamp to its recording, of poses at both ends; empty for what never moves."""

    def at(self, time_ns: int) -> Placed:
        """`fixed_from_sensor`. Raises WorldError when the bag cannot be read."""
        ...

    def velocity(self, time_ns: int) -> Velocity:
        """Of the sensor, m/s along the axes of the fixed frame."""
        ...


def find_motion(recording: Recording, sensor: str, settings: RobotSettings) -> Motion:
    """The motion of the frame `sensor`: by the odometry that settings name, else by tf from map or
    odom, else by the only odometry. Raises WorldError when there is none."""
    odometries = recording.topics_of(ODOMETRY)
    if settings.odometry:
        kind = recording.topics.get(settings.odometry)
        if kind != ODOMETRY:
            raise WorldError(
                f"topic {settings.odometry!r} of bag {recording.path} is "
                f"{kind or 'not there'}; {FILE_NAME} needs it to be {ODOMETRY}; there "
                f"{'are ' + ', '.join(odometries) if odometries else 'is none'}"
            )
        return _by_odometry(recording, settings.odometry, sensor, settings)
    frames = _Frames(recording)
    target = sensor if settings.sensor is None else frames.named(BASE)
    chain = frames.chain(target) if target else None
    if chain is not None:
        mount = np.eye(4) if settings.sensor is None else settings.sensor.pose().matrix()
        return _Chain(frames, chain, mount)
    if len(odometries) > 1:
        raise WorldError(
            f"bag {recording.path} has several {ODOMETRY} topics: {', '.join(odometries)}; name "
            f"one in {FILE_NAME} (odometry = ...)"
        )
    if not odometries:
        raise WorldError(_no_way(recording, frames, target or BASE))
    return _by_odometry(recording, odometries[0], sensor, settings, frames)


def _by_odometry(
    recording: Recording,
    topic: str,
    sensor: str,
    settings: RobotSettings,
    frames: _Frames | None = None,
) -> Motion:
    messages = recording.messages(topic)
    base = messages.decode(0, read_odometry).transform.child
    if settings.sensor is not None:
        mount: Matrix | None = settings.sensor.pose().matrix()
    elif base == sensor:
        mount = np.eye(4)
    else:
        mount = mounted((frames or _Frames(recording)).static, base, sensor)
    if mount is None:
        raise WorldError(
            f"bag {recording.path} does not say where {sensor!r}, the frame of its scans, is on "
            f"{base!r}, the frame of {topic}: no tf_static leads from one to the other; give the "
            f"robot's sensor (x, y, z, roll, pitch, yaw) in {FILE_NAME}"
        )
    return _Odometric(messages, mount)


def _no_way(recording: Recording, frames: _Frames, target: str) -> str:
    if not frames.parents:
        return (
            f"bag {recording.path} has neither {ODOMETRY} nor {TRANSFORMS} with messages in CDR: "
            f"where the robot is cannot be known{''.join('; ' + note for note in recording.notes)}"
        )
    edges = ", ".join(f"{parent} -> {child}" for child, parent in sorted(frames.parents.items()))
    return (
        f"tf of bag {recording.path} leads from none of {', '.join(FIXED)} to {target!r}, and it "
        f"has no {ODOMETRY}; it has {edges}"
    )


class _Odometric:
    """By odometry: a pose and a twist of the robot's base."""

    def __init__(self, messages: Messages, base_from_sensor: Matrix) -> None:
        self._messages = messages
        self._mount = base_from_sensor
        count = len(messages)
        # Some may have been recorded out of order.
        near = sorted({*range(min(_ENDS, count)), *range(max(0, count - _ENDS), count)})
        stamps = [messages.decode(index, read_stamp, STAMP_BYTES) for index in near]
        self.span_ns: tuple[int, int] | None = (min(stamps), max(stamps))
        self.lags_s = (messages.times_ns[near] - np.array(stamps, dtype=np.int64)) / 1e9

    @cached_property
    def _read(self) -> tuple[Track, list[Odometry]]:
        count = len(self._messages)
        all_ = [self._messages.decode(index, read_odometry) for index in range(count)]
        all_.sort(key=lambda one: one.transform.stamp_ns)
        return Track([one.transform for one in all_]), all_

    def at(self, time_ns: int) -> Placed:
        base = self._read[0].at(time_ns)
        return Placed(base.a_from_b @ self._mount, base.known)

    def velocity(self, time_ns: int) -> Velocity:
        track, all_ = self._read
        after = bisect_left(all_, time_ns, key=lambda one: one.transform.stamp_ns)
        near = min(
            all_[max(0, after - 1) : after + 1],
            key=lambda one: abs(one.transform.stamp_ns - time_ns),
        )
        return sensor_velocity(near, track.at(time_ns).a_from_b, self._mount)


class _Frames:
    """The frames of tf and which is whose parent."""

    def __init__(self, recording: Recording) -> None:
        topics = recording.topics_of(TRANSFORMS)
        self.static: dict[str, Transform] = {}
        for topic in topics:
            if topic.endswith("tf_static"):
                for one in _transforms(recording.messages(topic)):
                    self.static[one.child] = one
        self.moving = [recording.messages(t) for t in topics if not t.endswith("tf_static")]
        self.parents = {child: one.parent for child, one in self.static.items()}

    def named(self, name: str) -> str | None:
        """The frame of that name, with a robot's prefix or without."""
        moving = (one for messages in self.moving for one in _transforms(messages))
        for one in itertools.chain(self.static.values(), moving):
            for frame in (one.child, one.parent):
                if plain(frame) == name:
                    return frame
        return None

    def chain(self, frame: str) -> list[str] | None:
        """The frames from below a fixed frame down to a frame, each the child of the one before;
        None when no fixed frame leads there."""
        for messages in self.moving:
            for index in range(len(messages)):
                early = messages.times_ns[index] - messages.times_ns[0] < _LOOK_NS
                if not early and chain_down(self.parents, frame) is not None:
                    break
                for one in messages.decode(index, read_transforms):
                    self.parents.setdefault(one.child, one.parent)
        return chain_down(self.parents, frame)


class _Chain:
    """By tf: every frame of a chain in its parent."""

    def __init__(self, frames: _Frames, chain: list[str], mount: Matrix) -> None:
        self._frames = frames
        self._chain = chain
        self._mount = mount
        self.span_ns: tuple[int, int] | None = None
        self.lags_s = np.zeros(0)
        if any(frame not in frames.static for frame in chain):
            stamps, recorded = _ends(frames, chain)
            self.span_ns = int(stamps.min()), int(stamps.max())
            self.lags_s = (recorded - stamps) / 1e9

    @cached_property
    def _tracks(self) -> list[Track]:
        found: dict[str, list[Transform]] = {
            frame: [self._frames.static[frame]] if frame in self._frames.static else []
            for frame in self._chain
        }
        for messages in self._frames.moving:
            for one in _transforms(messages):
                # A frame that changes its parent half-way is followed under the first one only.
                its = self._frames.parents.get(one.child) == one.parent
                if its and one.child in found and one.child not in self._frames.static:
                    found[one.child].append(one)
        return [Track(found[frame]) for frame in self._chain]

    def at(self, time_ns: int) -> Placed:
        out, known = np.eye(4), True
        for track in self._tracks:
            placed = track.at(time_ns)
            out, known = out @ placed.a_from_b, known and placed.known
        return Placed(out @ self._mount, known)

    def velocity(self, time_ns: int) -> Velocity:
        if self.span_ns is None:
            return (0.0, 0.0, 0.0)
        begin = max(self.span_ns[0], time_ns - _DIFFERENCE_NS)
        end = min(self.span_ns[1], time_ns + _DIFFERENCE_NS)
        if end <= begin:
            return (0.0, 0.0, 0.0)
        moved = self.at(end).a_from_b[:3, 3] - self.at(begin).a_from_b[:3, 3]
        x, y, z = moved * 1e9 / (end - begin)
        return (float(x), float(y), float(z))


def _transforms(messages: Messages) -> Iterator[Transform]:
    for index in range(len(messages)):
        yield from messages.decode(index, read_transforms)


def _ends(frames: _Frames, chain: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first and the last stamps of a chain's moving frames, and when they were recorded, (N,)
    each. A topic may begin and end with
    messages that are empty or about other frames: both ends are searched for the nearest."""
    ends: list[tuple[int, int]] = []
    for messages in frames.moving:
        forwards = range(len(messages))
        for order in (forwards, reversed(forwards)):
            stamps: list[int] = []
            for index in order:
                stamps = [
                    one.stamp_ns
                    for one in messages.decode(index, read_transforms)
                    if one.child in chain and frames.parents.get(one.child) == one.parent
                ]
                if stamps:
                    break
            ends += [(stamp, int(messages.times_ns[index])) for stamp in stamps]
            if not stamps:
                break
    both = np.array(ends, dtype=np.int64)
    return both[:, 0], both[:, 1]
