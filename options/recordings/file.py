"""A recording's file: its header, and its messages by topic and time."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec

from options.bags.mcap_file import McapFile
from options.bags.storage import Place
from options.recordings.clouds import read_points
from options.recordings.format import (
    FRAME,
    HEADER,
    RAYS,
    READABLE,
    Frame,
    Header,
    Ranges,
    SensorRays,
    points_topic,
    ranges_topic,
)
from options.recordings.ranges import take_rays, take_scan
from swarm.errors import WorldError
from swarm.geometry import Points
from worlds.base import Rays

T = TypeVar("T")


class RecordingFile:
    """A file of `coadapt record`, whole or cut off. Threads may share it."""

    def __init__(self, path: Path) -> None:
        """Reads the index and the header. Raises WorldError that names what is missing."""
        self.path = Path(path)
        self._mcap = McapFile(self.path, ("json", "protobuf"), "recording")
        self.topics: dict[str, str] = dict(self._mcap.topics)
        """The schema of each topic that has messages."""
        self.notes: tuple[str, ...] = (
            (f"{path} is cut off ({self._mcap.cut}); what comes before is used",)
            if self._mcap.cut
            else ()
        )
        """What is wrong with a file that can be used all the same."""
        self._places: dict[str, dict[int, Place]] = {}
        if HEADER not in self.topics:
            there = ", ".join(sorted(self.topics)[:8]) or "none"
            raise WorldError(
                f"{path} is no recording of a swarm: it has no topic {HEADER}, which "
                f"`coadapt record` writes first (topics in it: {there})"
                + "".join(f"; {note}" for note in self.notes)
            )
        self.header = self.message(HEADER, self.times(HEADER)[0], Header)
        if self.header.version not in READABLE:
            raise WorldError(
                f"recording {path} has version {self.header.version}; this program reads "
                f"{' and '.join(map(str, READABLE))}"
            )
        self.rays = self._rays()
        """Of the robots' sensors; None where no scan is a range image."""

    def times(self, topic: str) -> list[int]:
        """When the messages of a topic were logged, ascending; empty where there are none."""
        return sorted(self._index(topic))

    def has(self, topic: str, time_ns: int) -> bool:
        """Whether a topic has a message of that time."""
        return time_ns in self._index(topic)

    def count(self, topic: str) -> int:
        """How many messages a topic has."""
        return len(self._mcap.index(topic)) if topic in self.topics else 0

    def message(self, topic: str, time_ns: int, kind: type[T]) -> T:
        """A JSON message. Raises WorldError when it is not there or is not of its kind."""
        raw = self._raw(topic, time_ns)
        try:
            return msgspec.json.decode(raw, type=kind)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise WorldError(
                f"a message of topic {topic} in recording {self.path} is malformed: {error}"
            ) from error

    def messages(self, topic: str, kind: type[T]) -> list[T]:
        """All JSON messages of a topic, by time."""
        return [self.message(topic, time_ns, kind) for time_ns in self.times(topic)]

    def frames(self) -> list[int]:
        """The capture times of the recorded frames. Raises WorldError when there are none."""
        times = self.times(FRAME)
        if not times:
            why = (
                "it was recorded with --points none"
                if self.header.points == "none"
                else "the ego fused none while it was recorded, or it is cut off before the first"
            )
            raise WorldError(f"recording {self.path} has no frames with scans: {why}")
        return times

    def frame(self, time_ns: int) -> Frame:
        """The robots in the frame of a capture time."""
        return self.message(FRAME, time_ns, Frame)

    def points(self, robot: str, time_ns: int) -> Points:
        """A scan: float32 (N, 3) in the sensor's frame."""
        topic = ranges_topic(robot)
        if self.has(topic, time_ns):
            if self.rays is None:
                raise WorldError(f"recording {self.path} has ranges, but lacks topic {RAYS}")
            try:
                return take_scan(self.message(topic, time_ns, Ranges), self.rays)
            except WorldError as error:
                raise WorldError(f"topic {topic} of recording {self.path}: {error}") from error
        topic = points_topic(robot)
        try:
            return read_points(self._raw(topic, time_ns))
        except WorldError as error:
            raise WorldError(f"topic {topic} of recording {self.path}: {error}") from error

    def _rays(self) -> Rays | None:
        times = self.times(RAYS)
        if not times:
            return None
        try:
            return take_rays(self.message(RAYS, times[0], SensorRays))
        except WorldError as error:
            raise WorldError(f"topic {RAYS} of recording {self.path}: {error}") from error

    def _raw(self, topic: str, time_ns: int) -> bytes:
        place = self._index(topic).get(time_ns)
        if place is None:
            raise WorldError(f"recording {self.path} has no message on {topic} at {time_ns} ns")
        return self._mcap.read(place)

    def _index(self, topic: str) -> dict[int, Place]:
        if topic not in self._places:
            found: dict[int, Place] = {}
            if topic in self.topics:
                index = self._mcap.index(topic)
                for time_ns, place in zip(
                    index.times_ns.tolist(), index.places.tolist(), strict=True
                ):
                    found[time_ns] = (place[0], place[1])
            self._places[topic] = found
        return self._places[topic]
