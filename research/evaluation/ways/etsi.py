"""The standard's way: every robot follows what it sees by itself, and tells of its objects when the
generation rules of ETSI TS 103 324 say so; the ego holds what it heard.

Bytes are those of the messages in UPER, as `options.etsi` encodes them, without the headers of what
carries them: of the other ways none are counted either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from perception.codec.boxes import encode_boxes
from perception.codec.outlined import add_outline
from perception.collective.generation import Generation, Seen
from perception.collective.received import Received
from perception.detector.calibration import ALONE, calibration_of
from perception.fusion.base import Contribution
from perception.fusion.known import seen_at
from perception.fusion.mixed import Mixed
from perception.fusion.registry import make_fusion
from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.remembering import remember
from perception.types import Boxes
from research.evaluation.ways.drive import NOWHERE, Drive, Driven, Focus, FusedOnce
from swarm.geometry import Pose, invert
from worlds.cooperative.fusing import SINGLE, known_robots
from worlds.cooperative.pose_errors import disturbed

FORM = "late"
PERSON = "person"
MESSAGE_BITS, CONTAINER_BITS = 260, 18
"""Of a message of a station that moves without its container of objects; of that without any."""
OBJECT_BITS = {"forklift": 261, "car": 261, "truck": 261, PERSON: 264}
OTHER_BITS = 265
"""Of an object of another label."""
LONG_BYTES = 128
"""From here on a container's length takes two bytes."""
SIDE_M, PLACE_M, TURN_RAD = 0.1, 0.01, np.radians(0.1)
"""What sides, places (and speeds, a second) and headings are rounded to."""


def message_bytes(labels: Sequence[str]) -> int:
    """Of a message about objects of these labels."""
    container = CONTAINER_BITS + sum(OBJECT_BITS.get(label, OTHER_BITS) for label in labels)
    octets = -(-container // 8)
    return -(-(MESSAGE_BITS + 8 * (1 if octets < LONG_BYTES else 2) + 8 * octets) // 8)


class Station:
    """One robot that follows the standard: what it sees, and what it tells of that."""

    def __init__(self, detector: str, *, mitigates: bool) -> None:
        self._memory = Memory.of_detector(detector)
        self._curve = calibration_of(detector).curves[ALONE]
        self._detector = detector
        self.rules = Generation(mitigates=mitigates)

    def look(self, frame: Frame) -> Remembered:
        """What it knows after a frame of its own, with scores as its detector would give them."""
        told = remember(self._memory, frame, self._detector, SINGLE, ())
        assert told is not None, "only calibrated detectors are measured"
        chance = np.clip(told.boxes.scores, 1e-4, 1.0 - 1e-4)
        logit = (np.log(chance / (1.0 - chance)) - self._curve.offset) / self._curve.slope
        return replace(told, boxes=replace(told.boxes, scores=1.0 / (1.0 + np.exp(-logit))))


class EtsiDriven(Driven):
    """A drive on which all robots but the ego send what the rules say, whatever they are asked."""

    def __init__(self, drive: Drive, *, mitigates: bool = False) -> None:
        """`mitigates`: leaves out what others have told already."""
        super().__init__(drive)
        self._late = make_fusion(FORM, self.world.detector)
        self._stations = {
            robot: Station(self.world.detector, mitigates=mitigates) for robot in self.nearest
        }
        self._received = {robot: Received() for robot in self.nearest}
        self._sent: dict[tuple[str, int], Remembered | None] = {}
        """What each robot tells in a frame; None where it sends nothing."""

    def size(
        self, frame: int, robot: str, name: str, max_error_m: float, focus: Focus | None = None
    ) -> int:
        """The bytes of what a robot sends in a frame. Frames must follow each other."""
        sent = self._tell(robot, frame)
        return 0 if sent is None else message_bytes(sent.boxes.labels)

    def fused(
        self,
        frame: int,
        asked: Mapping[str, str],
        max_error_m: float,
        places: Mapping[str, Focus] = NOWHERE,
    ) -> FusedOnce:
        """The frame as the ego sees it, with what it has heard by then. `asked`: those whose
        messages of this frame come. Frames must follow each other."""
        now_s = frame / self.world.rate_hz
        for robot in asked:
            if (sent := self._tell(robot, frame)) is not None:
                ids = tuple(int(one) for one in sent.ids)
                self._received[robot].take(now_s, ids, sent.boxes, sent.velocities)
        own = self.world.scan(self.ego, frame)
        here = own.pose.matrix()
        gathering = Mixed({FORM: self._late}).begin(own.points, here)
        helpers = set()
        for robot, received in self._received.items():
            if len(boxes := received.at(now_s)):
                there = self.world.pose(robot, frame).matrix()
                payload = encode_boxes(boxes.transformed(invert(there)))
                outlined = add_outline(payload, np.zeros((0, 2)))
                gathering.add(Contribution(robot, outlined, there, form=FORM))
                helpers.add(robot)
        found = gathering.finish()
        known = known_robots(self.world, frame, self.ego, self.drive.pose_noise_m)
        return FusedOnce(
            found,
            FORM if helpers else SINGLE,
            frozenset(helpers),
            {robot: self.size(frame, robot, FORM, max_error_m) for robot in asked},
            seen_at(known, gathering.corrections()),
            {self.ego: (own.points, here)},
            here,
        )

    def _tell(self, robot: str, frame: int) -> Remembered | None:
        if (robot, frame) not in self._sent:
            self._sent[robot, frame] = self._told(robot, frame)
        return self._sent[robot, frame]

    def _told(self, robot: str, frame: int) -> Remembered | None:
        now_s = frame / self.world.rate_hz
        scan = self.world.scan(robot, frame)
        believed = disturbed(scan.pose, robot, frame, self.drive.pose_noise_m)
        here = believed.matrix()
        alone = Mixed({FORM: self._late}).begin(scan.points, here).finish()
        views = {robot: (scan.points, here)}
        station = self._stations[robot]
        seen = station.look(Frame(now_s, alone, frozenset(), views, here))
        due = station.rules.due(now_s, _seen(seen))
        if due is None:
            return None
        told = _as_told(seen.take(np.array(due, dtype=np.intp)), believed)
        for other, listener in self._stations.items():
            if other != robot:
                listener.rules.hear(now_s, _seen(told))
        return told


def _seen(told: Remembered) -> list[Seen]:
    rows = zip(told.ids, told.boxes.labels, told.boxes.centers, told.velocities, strict=True)
    return [
        Seen(int(id_), label == PERSON, float(x), float(y), float(v[0]), float(v[1]))
        for id_, label, (x, y, _), v in rows
    ]


def _as_told(told: Remembered, station: Pose) -> Remembered:
    """As a message carries it, from the station's place on."""
    origin = np.array([station.x, station.y, station.z])
    boxes = told.boxes
    rounded: Boxes = replace(
        boxes,
        centers=np.rint((boxes.centers - origin) / PLACE_M) * PLACE_M + origin,
        sizes=np.clip(np.rint(boxes.sizes / SIDE_M), 1, 254) * SIDE_M,
        headings=np.rint(boxes.headings / TURN_RAD) * TURN_RAD % (2.0 * np.pi),
        scores=np.rint(15.0 * boxes.scores) / 15.0,
    )
    return replace(told, boxes=rounded, velocities=np.rint(told.velocities / PLACE_M) * PLACE_M)
