"""One ego as a station of ETSI's: which messages it sends about what it found."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from options.etsi.anchor import Anchor
from options.etsi.message import Cpm, Told
from perception.collective.generation import Generation, Seen
from swarm.arrays import unpack_finite
from swarm.errors import MessageError
from swarm.geometry import Pose
from swarm.messages import Detections, KnownRobot

PERSON = "person"
FIRST_ROBOT = 65_535
"""Known robots are numbered from here down, tracks from 1 up."""


class Station:
    """Turns an ego's detections into messages when the generation rules say so. For one thread."""

    def __init__(self, number: int, anchor: Anchor) -> None:
        """`number`: the station's identifier, 0 to 2**32 - 1."""
        self._number = number
        self._anchor = anchor
        self._rules = Generation()
        self._robots: dict[str, int] = {}

    def message(self, found: Detections, ego: Pose) -> Cpm | None:
        """What to send about a frame, if anything; `ego`: where the ego is. Robots whose beacons
        are doubted are left out: a station vouches for what it tells.

        Raises MessageError for arrays that are none.
        """
        robots = [self._robot(one, ego) for one in found.known if not one.doubt]
        objects = [*self._tracks(found, ego), *robots]
        due = self._rules.due(found.capture_ns / 1e9, [_seen(one, ego) for one in objects])
        if due is None:
            return None
        latitude, longitude = self._anchor.degrees(ego.x, ego.y)
        return Cpm(
            station=self._number,
            unix_ms=found.capture_ns // 1_000_000,
            latitude=latitude,
            longitude=longitude,
            orientation=ego.heading,
            objects=tuple(objects[place] for place in due),
        )

    def _tracks(self, found: Detections, ego: Pose) -> list[Told]:
        tracks = found.tracks
        if tracks is None:
            raise MessageError(
                f"ego {found.ego} keeps no memory (COADAPT_MEMORY): its objects have no identity, "
                "by which a CPM tells of them"
            )
        rows = unpack_finite(tracks.boxes, "tracks.boxes", 7).astype(np.float64).tolist()
        scores = unpack_finite(tracks.scores, "tracks.scores", 1)[:, 0].tolist()
        moving = unpack_finite(tracks.velocities, "tracks.velocities", 2).tolist()
        if not len(tracks.ids) == len(tracks.labels) == len(rows) == len(scores) == len(moving):
            raise MessageError(f"detections of frame {found.frame} tell of tracks in part only")
        return [
            Told(
                id=id_ % FIRST_ROBOT,
                label=label,
                center=(row[0] - ego.x, row[1] - ego.y, row[2] - ego.z),
                size=(row[3], row[4], row[5]),
                heading=row[6],
                velocity=(speed[0], speed[1]),
                score=score,
            )
            for id_, label, row, score, speed in zip(
                tracks.ids, tracks.labels, rows, scores, moving, strict=True
            )
        ]

    def _robot(self, one: KnownRobot, ego: Pose) -> Told:
        number = self._robots.setdefault(one.robot, FIRST_ROBOT - len(self._robots))
        x, y, z = one.center
        return Told(
            id=number,
            label=one.label,
            center=(x - ego.x, y - ego.y, z - ego.z),
            size=one.size,
            heading=one.heading,
            velocity=one.velocity or (0.0, 0.0),
            score=1.0,
        )


def in_world(message: Cpm, anchor: Anchor) -> Mapping[int, Told]:
    """The objects of anybody's message, by their numbers, with places in the world frame."""
    x, y = anchor.metres(message.latitude, message.longitude)
    return {
        one.id: Told(
            one.id,
            one.label,
            (one.center[0] + x, one.center[1] + y, one.center[2]),
            one.size,
            one.heading,
            one.velocity,
            one.score,
            one.age_s,
        )
        for one in message.objects
    }


def _seen(one: Told, ego: Pose) -> Seen:
    x, y, _ = one.center
    return Seen(one.id, one.label == PERSON, ego.x + x, ego.y + y, *one.velocity)
