"""What an ego found and what nobody sees, as the messages of three ROS 2 topics."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from options.ros.definitions import DETECTIONS, GRID, MARKERS
from options.ros.outgoing import Object, detections, grid, markers
from options.ros.writer import NS
from swarm.arrays import unpack_finite
from swarm.errors import MessageError
from swarm.geometry import TWO_PI
from swarm.messages import Detections, SceneDescription, Tracks

PREFIX = "/coadapt"
RESOLUTION_M = 0.5
REACH_M = 40.0
"""The grid's from the ego to each side."""
FRESH_NS = 3_000_000_000
"""A robot whose last scene came longer ago does not say any more what is free."""
LATEST_NS = 2**31 * NS
"""Where the stamps of ROS 2 end, in the year 2038."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic, without its prefix."""

    name: str
    kind: str
    kept: bool = False
    """Who subscribes later gets the last message, too (transient local), as of a map."""


OBJECTS = Topic("/objects", DETECTIONS)
DRAWN = Topic("/markers", MARKERS)
UNSEEN = Topic("/unseen", GRID, kept=True)
TOPICS = (OBJECTS, DRAWN, UNSEEN)


@dataclass(frozen=True, slots=True)
class Said:
    """One message."""

    topic: Topic
    payload: bytes
    """CDR."""
    stamp_ns: int
    """Of what it tells, nanoseconds since the Unix epoch."""


class Teller:
    """Turns what the swarm says of one ego into messages; keeps each robot's newest scene."""

    def __init__(self, ego: str) -> None:
        self._ego = ego
        self._scenes: dict[str, tuple[SceneDescription, int]] = {}

    def on_detections(self, message: Detections) -> tuple[Said, ...]:
        """Objects, and how to draw them. Raises MessageError for arrays that are none."""
        stamp_ns = _checked(message.capture_ns)
        found = objects_of(message)
        return (
            Said(OBJECTS, detections(found, stamp_ns), stamp_ns),
            Said(DRAWN, markers(found, stamp_ns), stamp_ns),
        )

    def on_scene(self, message: SceneDescription, came_ns: int) -> tuple[Said, ...]:
        """With the ego's own scene, what nobody sees around it; with another one nothing yet.

        came_ns: now, on one clock for all. Raises MessageError for an array that is none.
        """
        unpack_finite(message.visible_m, "visible_m", 1)
        stamp_ns = _checked(message.capture_ns)
        self._scenes[message.robot] = message, came_ns
        if message.robot != self._ego:
            return ()
        self._scenes = {
            robot: kept
            for robot, kept in self._scenes.items()
            if abs(came_ns - kept[1]) <= FRESH_NS
        }
        x, y = (
            np.floor(place / RESOLUTION_M) * RESOLUTION_M - REACH_M for place in message.pose[:2]
        )
        side = np.arange(round(2 * REACH_M / RESOLUTION_M)) * RESOLUTION_M + RESOLUTION_M / 2
        seen = np.zeros((len(side), len(side)), dtype=bool)
        for scene, _ in self._scenes.values():
            seen |= _seen_by(scene, x + side, y + side)
        payload = grid(seen, (float(x), float(y)), RESOLUTION_M, stamp_ns)
        return (Said(UNSEEN, payload, stamp_ns),)


def _checked(stamp_ns: int) -> int:
    if stamp_ns >= LATEST_NS:
        raise MessageError(
            f"a message tells of {stamp_ns} ns; ROS 2 can name times before {LATEST_NS} ns"
        )
    return stamp_ns


def objects_of(message: Detections) -> list[Object]:
    """What the ego remembers, or where it keeps no memory what it found in this frame; and the
    robots that told where they are, each under its own name; not those that are doubted, as ROS 2's
    message has no word for that.

    Raises MessageError for arrays that are none.
    """
    tracks = message.tracks
    found = _of_frame(message) if tracks is None else remembered(tracks)
    return found + [
        Object(one.robot, one.label, one.center, one.size, one.heading, score=1.0)
        for one in message.known
        if not one.doubt
    ]


def remembered(tracks: Tracks) -> list[Object]:
    """What the ego remembers. Raises MessageError for arrays that are none."""
    names = [str(one) for one in tracks.ids]
    rows = unpack_finite(tracks.boxes, "tracks.boxes", 7).astype(np.float64).tolist()
    scores = unpack_finite(tracks.scores, "tracks.scores", 1)[:, 0].tolist()
    moving = unpack_finite(tracks.velocities, "tracks.velocities", 2).astype(np.float64).tolist()
    ages = unpack_finite(tracks.ages_s, "tracks.ages_s", 1)[:, 0].tolist()
    return _objects(names, list(tracks.labels), rows, scores, moving, ages)


def _of_frame(message: Detections) -> list[Object]:
    rows = unpack_finite(message.boxes, "boxes", 7).astype(np.float64).tolist()
    scores = unpack_finite(message.scores, "scores", 1)[:, 0].tolist()
    count = len(rows)
    still: list[list[float]] = list(repeat([0.0, 0.0], count))
    return _objects([""] * count, list(message.labels), rows, scores, still, [0.0] * count)


def _objects(
    names: list[str],
    labels: list[str],
    rows: list[list[float]],
    scores: list[float],
    moving: list[list[float]],
    ages: list[float],
) -> list[Object]:
    if not len(names) == len(labels) == len(rows) == len(scores) == len(moving) == len(ages):
        raise MessageError(
            f"detections name {len(names)} objects with {len(labels)} labels, {len(rows)} boxes, "
            f"{len(scores)} scores, {len(moving)} velocities and {len(ages)} ages; they must be "
            "as many of each"
        )
    return [
        Object(
            name,
            label,
            (row[0], row[1], row[2]),
            (row[3], row[4], row[5]),
            row[6],
            score,
            (speed[0], speed[1]),
            age,
        )
        for name, label, row, score, speed, age in zip(
            names, labels, rows, scores, moving, ages, strict=True
        )
    ]


def _seen_by(
    scene: SceneDescription, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which cells with their middles at `y` (rows) and `x` (columns) a robot sees: bool (Y, X)."""
    visible = unpack_finite(scene.visible_m, "visible_m", 1)[:, 0]
    if not len(visible):
        return np.zeros((len(y), len(x)), dtype=bool)
    dx, dy = x[None, :] - scene.pose[0], y[:, None] - scene.pose[1]
    turn = np.arctan2(dy, dx) % TWO_PI / TWO_PI
    sector = np.minimum((turn * len(visible)).astype(np.intp), len(visible) - 1)
    seen: NDArray[np.bool_] = np.hypot(dx, dy) <= visible[sector]
    return seen
