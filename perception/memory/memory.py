"""Objects remembered from frame to frame.

Each track has an identity, a class, a motion (`motion`) and a heading (`turning`), the shape that
its best views (`viewers`) showed, and the chance that it exists. Boxes are laid on tracks together
as near as can be within a gate (global nearest neighbour). The chance follows Musicki, Evans and
Stankovic, "Integrated probabilistic data association" (1994): a box that should have been seen and
was not makes a track less likely by how likely it was to be seen, and what could not be seen says
nothing. Calibrated boxes tell the chance themselves; as boxes of frames that follow each other are
no independent witnesses, their chances are pooled (logarithmic opinion pool).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from perception.boxes import SHARPNESS, iou_among, iou_bev
from perception.codec.places import Places, within
from perception.detector.config import configuration
from perception.jumps import Whereabouts
from perception.memory.motion import Motions
from perception.memory.registration import FRESH_S, Cloud, Look, displaced
from perception.memory.sight import Sight
from perception.memory.structure import Structure
from perception.memory.turning import Headings
from perception.memory.viewers import Robots, Viewers
from perception.types import Boxes
from swarm.geometry import Matrix, Points, invert, transform

Floats = NDArray[np.float64]

MOST_TRACKS = 256
MOST_BOXES = 200
"""Of one frame, the surest."""
FAINTEST = 0.1
"""Less sure boxes are not remembered."""
GONE = 0.02
"""A track less likely than this ends."""
LONGEST_S = 60.0
"""No track lives longer than this unseen."""
GATE = 13.8
"""Squared distance, in variances, beyond which a box is not a track's: 99.9 % of two axes."""
SURE_SD_M, DOUBT_SD_M = 0.05, 0.3
"""Standard deviation of a box's middle along an axis: of a sure one, and what a doubtful one has
more. Measured on floors of seeds from 1,700,000 on."""
SURE_RAD, DOUBT_RAD = 0.07, 0.5
"""The same of its heading, rad. Measured on floors and streets of seeds from 1,920,000 on."""
WEIGHT, CUT_OUT = 0.5, 0.12
"""Of a box's chance beside what is remembered, where as many robots showed both, and where some of
them showed places only: what is cut out of its surroundings looks like an object more easily.
Measured on floors of seeds from 1,945,000 on."""
PARTIAL_SD, PARTIAL_WEIGHT, OFFSET = 2.0, 0.1, 0.07
"""Of a box of fewer views than those that showed the track: how much farther off it is, what its
shape counts for, and the standard deviation of the offset of its middle, by the body's length.
Measured on floors and streets of seeds from 1,920,000 on."""
FADES_S = 1.0
"""In this time a remembered shape loses two thirds of its weight."""
SURVIVES_S = 30.0
"""How long what nobody sees is believed in, on average."""
SAME_PLACE = 0.1
"""Two solid bodies do not overlap this much."""
FEW, MANY = 3, 30
"""Returns that tell whether a place is free, and from which on an object would be found by anybody
(docs/decision.md)."""
LOOKED_AT, TOLD_AGAIN, SEEN_FREE = 0.7, 0.6, 0.95
"""How likely an object that exists would have been found: where there is something, by the clouds
of those who showed it before; where those who showed it before sent boxes or features again; where
rays pass through its place (so it is not there)."""
UNCONFIRMED = 0.2
"""Of the chance of a new box that the ego alone shows, where others have sent of late
(`viewers.INFORMED_S`); of one that a part of these shows, as much more as they are."""
NEAR_ENOUGH = 0.5
"""Of a body's width: an offset beyond which a box of it is wrong."""
SQUARE = 0.1
"""By how much of the longer side those of a square differ at most."""
MAY_MOVE, MOST_LOOKED_FOR = 0.3, 24
"""Chance that a track moves from which on the ego looks for it by its points, and of how many."""
CLIP = 1e-3
"""Chances are kept this far from 0 and 1."""


View = tuple[Points, Matrix]
"""A cloud, float32 (N, 3) in its sensor's frame, and the sensor in the world frame, 4 x 4."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What an ego found in a frame, in the world frame."""

    time_s: float
    """Capture, seconds of one clock."""
    boxes: Boxes
    """Scores are chances."""
    helpers: frozenset[str] = frozenset()
    """Robots whose contributions are in it."""
    views: Mapping[str, View] = field(default_factory=dict)
    """By robot: the ego's, ground included, and those of helpers that sent points."""
    world_from_own: Matrix | None = None
    completes: bool = True
    """Whether boxes were found in what helpers and ego show together, not each by itself."""
    focused: frozenset[str] = frozenset()
    """Helpers that were asked about places only."""
    places: Places = b""
    """Which, in the frame of the ego's sensor."""
    objects_only: frozenset[str] = frozenset()
    """Helpers that sent only what may be objects, by themselves: they have no view."""


@dataclass(frozen=True, slots=True, eq=False)
class Remembered:
    """The objects of a moment, in the world frame, the likeliest first."""

    boxes: Boxes
    """Scores are the chances that the boxes are right."""
    ids: NDArray[np.int64]
    velocities: Floats
    """(N, 2) m/s."""
    ages_s: Floats
    """Since each was seen last: 0 in this frame."""

    def take(self, rows: NDArray[np.intp]) -> Remembered:
        """Those at the given positions."""
        return Remembered(
            self.boxes.take(rows), self.ids[rows], self.velocities[rows], self.ages_s[rows]
        )


class Memory:
    """What one ego remembers. For one thread."""

    def __init__(self, usual_speed_m_s: float, tallest_m: float = math.inf) -> None:
        """`usual_speed_m_s`: standard deviation of an object's velocity along an axis.
        `tallest_m`: no object is taller; without it nothing is taken for structure."""
        self._usual = usual_speed_m_s
        self._structure = Structure(tallest_m)
        self._next = 1
        self._whereabouts = Whereabouts()
        """The ego's."""
        self.clear()

    @classmethod
    def of_detector(cls, name: str) -> Memory:
        """Of what a detector finds. Raises PerceptionError for an unknown one."""
        of = configuration(name)
        return cls(of.usual_speed_m_s, of.tallest_m)

    def clear(self) -> None:
        """Forgets everything but which numbers were given."""
        self._time_s: float | None = None
        self._structure.clear()
        self._motions, self._headings = Motions(self._usual), Headings()
        self._viewers = Viewers()
        self._boxes = Boxes.empty()
        """As last seen, with the shape of the best views; scores are the tracks' chances."""
        self._ids = np.zeros(0, dtype=np.int64)
        self._weights = np.zeros(0)
        """Of the remembered shapes."""
        self._seen_s = np.zeros(0)
        self._certain = np.zeros(0)
        """How certain the place was when last seen."""
        self._looks: list[Look | None] = []
        """At each track when it was shown whole."""

    def update(self, frame: Frame) -> Remembered:
        """Takes up a frame, and returns what is there at its time by all that is known."""
        dt_s = self._begin(frame)
        self._motions.predict(dt_s, self._headings.rates())
        self._headings.predict(dt_s, _square(self._boxes))
        self._weights = self._weights * np.exp(-dt_s / FADES_S)
        chances = self._boxes.scores * np.exp(-dt_s / SURVIVES_S)
        self._boxes = replace(
            self._boxes,
            centers=self._moved(),
            headings=self._headings.headings(),
            scores=chances,
        )
        self._structure.learn(frame.time_s, frame.views)
        judged = self._structure.judged(frame.boxes)
        order = np.argsort(-judged.scores, kind="stable")[:MOST_BOXES]
        found = judged.take(order[judged.scores[order] >= FAINTEST])
        asked = self._asked(frame)
        whole = frame.helpers - frame.focused
        partial = self._viewers.partial(frame.helpers)
        partial[~asked] = self._viewers.partial(whole)[~asked]
        own = _own_cloud(frame)
        if own is not None:
            self._looked_for(np.flatnonzero(partial), own, frame.time_s)
        rows, columns = self._matched(found, partial)
        showing = [frame.helpers if about else whole for about in asked]
        self._missed(np.setdiff1d(np.arange(len(self._ids)), rows), frame, showing)
        self._seen(rows, found.take(columns), partial[rows], frame, showing)
        self._born(found.take(np.setdiff1d(np.arange(len(found)), columns)), frame)
        self._prune(frame.time_s)
        if own is not None:
            self._look(own, frame.time_s)
        return self._told(frame.time_s)

    def suspected(self) -> Remembered:
        """All that may be there at the newest frame's time, unless it is very unlikely."""
        told = self._told(self._time_s or 0.0)
        return told.take(np.flatnonzero(told.boxes.scores >= FAINTEST))

    def number_after(self, other: Memory) -> None:
        """Gives new tracks numbers that another memory has not given."""
        self._next = max(self._next, other._next)

    def recognise(self, other: Memory) -> Remembered:
        """Names tracks of its own as another memory of the same time does that has not got them
        under their numbers, where both tell of one thing; returns what is there then."""
        assert self._time_s is not None
        own = np.flatnonzero(~np.isin(self._ids, other._ids))
        theirs = np.flatnonzero(~np.isin(other._ids, self._ids))
        if len(own) and len(theirs):
            shared = iou_bev(self._boxes.take(own), other._boxes.take(theirs))
            labels = np.array(self._boxes.labels), np.array(other._boxes.labels)
            shared[labels[0][own][:, None] != labels[1][theirs]] = 0.0
            for i in np.argsort(-shared.max(axis=1), kind="stable"):
                j = int(shared[i].argmax())
                if shared[i, j] > SAME_PLACE:
                    self._ids[own[i]] = other._ids[theirs[j]]
                    shared[:, j] = 0.0
        return self._told(self._time_s)

    def _begin(self, frame: Frame) -> float:
        """Seconds since the frame before; forgets everything where clock or place have jumped."""
        dt_s = 0.0 if self._time_s is None else frame.time_s - self._time_s
        jumped = dt_s < 0.0 or dt_s > LONGEST_S
        if jumped:
            self._whereabouts.forget()
        if frame.world_from_own is not None:
            jumped |= self._whereabouts.jumps(frame.time_s, frame.world_from_own)
        if jumped:
            self.clear()
            dt_s = 0.0
        self._viewers.hear(frame.time_s, frame.helpers)
        self._time_s = frame.time_s
        return dt_s

    def _looked_for(self, rows: NDArray[np.intp], own: Cloud, time_s: float) -> None:
        """Finds moving tracks by the ego's own points of them."""
        moving, sds = self._motions.moving(), self._motions.sds()
        seen, places, place_sds = [], [], []
        for row in rows[moving[rows] > MAY_MOVE][:MOST_LOOKED_FOR]:
            look = self._looks[row]
            if look is None or time_s - look.time_s > FRESH_S:
                continue
            here = displaced(look, own, self._boxes.take(np.array([row])), float(sds[row]))
            if here is not None:
                seen.append(row)
                places.append(here[0])
                place_sds.append(here[1])
        if seen:
            whole = np.zeros(len(seen), dtype=np.bool_)
            self._motions.update(np.array(seen), np.array(places), np.array(place_sds), whole)
            self._boxes.centers[:, :2] = self._motions.places()

    def _look(self, own: Cloud, time_s: float) -> None:
        """Keeps what the ego sees of tracks that are shown whole now."""
        for row in np.flatnonzero(self._viewers.whole()):
            self._looks[row] = Look(time_s, own, self._boxes.take(np.array([row])))

    def _asked(self, frame: Frame) -> NDArray[np.bool_]:
        """(N,): tracks that all helpers of a frame were asked about."""
        if not frame.focused or frame.world_from_own is None or not len(self._ids):
            return np.full(len(self._ids), not frame.focused)
        own_from_world = invert(frame.world_from_own)
        return within(frame.places, transform(own_from_world, self._boxes.centers))

    def _moved(self) -> Floats:
        return np.column_stack([self._motions.places(), self._boxes.centers[:, 2]])

    def _matched(
        self, found: Boxes, partial: NDArray[np.bool_]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Tracks and the boxes that show them; of some tracks (N,) a part, it may be."""
        from scipy.optimize import linear_sum_assignment

        if not len(found) or not len(self._ids):
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        apart = self._motions.apart(found.centers[:, :2], _sds(found), partial)
        other = np.array(self._boxes.labels)[:, None] != np.array(found.labels)
        cost = np.where(other, GATE, np.minimum(apart, GATE))
        rows, columns = linear_sum_assignment(cost)
        close = cost[rows, columns] < GATE
        rows, columns = rows[close], columns[close]
        # One that moved on faster than anybody could know still covers its place.
        left = np.setdiff1d(np.arange(len(self._ids)), rows)
        free = np.setdiff1d(np.arange(len(found)), columns)
        shared = iou_bev(self._boxes.take(left), found.take(free))
        shared[other[np.ix_(left, free)]] = 0.0
        more, others = linear_sum_assignment(-shared)
        over = shared[more, others] > SAME_PLACE
        return (
            np.concatenate([rows, left[more[over]]]),
            np.concatenate([columns, free[others[over]]]),
        )

    def _missed(self, rows: NDArray[np.intp], frame: Frame, showing: Sequence[Robots]) -> None:
        """Tracks that no box shows: were they to be seen? `showing`: helpers that could show each
        track."""
        if not len(rows):
            return
        expected = np.zeros(len(rows))
        there, through = np.zeros((2, len(rows)), dtype=np.int64)
        boxes = self._boxes.take(rows)
        for points, world_from_sensor in frame.views.values():
            more = Sight(points).of(boxes.transformed(invert(world_from_sensor)))
            there, through = there + more[0], through + more[1]
        # A place that is not known well may be free while the object stands beside it.
        sd = self._motions.sds()[rows]
        width = boxes.sizes[:, :2].min(axis=1)
        told = np.minimum(1.0, width / (4.0 * sd))
        free = (through >= FEW) & (there < FEW)
        expected = np.where(free, SEEN_FREE * told, expected)
        for i, row in enumerate(rows):
            best = self._viewers.best(row)
            unseen = best - frame.views.keys()
            if unseen <= showing[row] and (unseen or not frame.views):
                expected[i] = max(expected[i], TOLD_AGAIN)
            elif there[i] >= MANY or (there[i] >= FEW and best <= showing[row]):
                expected[i] = max(expected[i], LOOKED_AT)
        chance = self._boxes.scores
        left = chance[rows] * (1.0 - expected) / (1.0 - expected * chance[rows])
        chance[rows] = left

    def _seen(
        self,
        rows: NDArray[np.intp],
        found: Boxes,
        partial: NDArray[np.bool_],
        frame: Frame,
        showing: Sequence[Robots],
    ) -> None:
        """Tracks and the box that shows each; of some (K,) a part, it may be. `showing`: helpers
        that could show each track."""
        if not len(rows):
            return
        chance, boxes = self._boxes.scores, self._boxes
        # Other robots may see more; what the ego sees alone was in what they completed.
        by = [showing[row] for row in rows]
        alone = np.array([not helpers for helpers in by], dtype=np.bool_)
        known = self._viewers.completed(rows) & alone
        full = ~partial | ((found.scores > chance[rows]) & ~known)
        anew = self._viewers.saw(rows, full, by, frame.completes)
        farther = np.where(full, 1.0, PARTIAL_SD)
        self._motions.lose_offsets(rows[anew])
        self._motions.update(rows, found.centers[:, :2], _sds(found) * farther, ~full)
        self._headings.update(
            rows, found.headings, _turned_sds(found) * farther, _square(boxes.take(rows))
        )
        told = CUT_OUT if frame.focused else WEIGHT
        for row, box in zip(rows[full], np.flatnonzero(full), strict=True):
            chance[row] = _pooled(chance[row], found.scores[box], told)
        weight = found.scores**SHARPNESS * np.where(full, 1.0, PARTIAL_WEIGHT)
        shape = weight / np.maximum(weight + self._weights[rows], 1e-12)
        self._weights[rows] += weight
        boxes.headings[:] = self._headings.headings()
        boxes.sizes[rows] += shape[:, None] * (found.sizes - boxes.sizes[rows])
        boxes.centers[rows, 2] += shape * (found.centers[:, 2] - boxes.centers[rows, 2])
        boxes.centers[:, :2] = self._motions.places()
        self._seen_s[rows] = frame.time_s
        self._certain[rows] = self._certainty()[rows]

    def _born(self, found: Boxes, frame: Frame) -> None:
        """Boxes that show no track; those within a body that is remembered show a part of it."""
        if len(self._ids):
            apart = (iou_bev(found, self._boxes) <= SAME_PLACE).all(axis=1)
            found = found.take(np.flatnonzero(apart))
        if not len(found):
            return
        # Of those who see more, so many have not shown it; what was cut out of its surroundings
        # has to be shown by those who are asked about its place.
        helpers = frame.helpers - frame.focused - frame.objects_only
        others = 1.0 - self._viewers.share(helpers)
        found = replace(found, scores=found.scores * UNCONFIRMED**others)
        offsets = OFFSET * found.sizes[:, :2].max(axis=1)
        self._motions.add(found.centers[:, :2], _sds(found), offsets)
        self._headings.add(found.headings, _turned_sds(found))
        self._viewers.add(len(found), helpers, frame.completes)
        self._boxes = Boxes.concatenate([self._boxes, found])
        self._ids = np.append(self._ids, self._next + np.arange(len(found)))
        self._next += len(found)
        self._weights = np.append(self._weights, found.scores**SHARPNESS)
        self._seen_s = np.append(self._seen_s, np.full(len(found), frame.time_s))
        self._certain = np.append(self._certain, self._certainty()[-len(found) :])
        self._looks += [None] * len(found)

    def _certainty(self) -> Floats:
        """The chance that each track's box lies near enough to be right."""
        return self._motions.near(NEAR_ENOUGH * self._boxes.sizes[:, :2].min(axis=1))

    def _prune(self, time_s: float) -> None:
        """The likeliest tracks, of those in one place the likeliest."""
        boxes = self._boxes
        alive = (boxes.scores >= GONE) & (time_s - self._seen_s <= LONGEST_S)
        order = np.flatnonzero(alive)[np.argsort(-boxes.scores[alive], kind="stable")]
        order = order[:MOST_TRACKS]
        overlap = iou_among(boxes.take(order)) > SAME_PLACE
        kept = np.ones(len(order), dtype=np.bool_)
        for i in range(len(order)):
            if kept[i]:
                kept[i + 1 :] &= ~overlap[i, i + 1 :]
        rows = order[kept]
        for part in (self._motions, self._headings, self._viewers):
            part.keep(rows)
        self._boxes, self._ids = boxes.take(rows), self._ids[rows]
        self._weights, self._seen_s = self._weights[rows], self._seen_s[rows]
        self._certain = self._certain[rows]
        self._looks = [self._looks[row] for row in rows]

    def _told(self, time_s: float) -> Remembered:
        scores = self._boxes.scores * np.minimum(1.0, self._certainty() / self._certain)
        told = Remembered(
            replace(self._boxes, scores=scores),
            self._ids,
            self._motions.velocities(),
            time_s - self._seen_s,
        )
        return told.take(np.argsort(-scores, kind="stable"))


def _own_cloud(frame: Frame) -> Cloud | None:
    """What the ego sees."""
    for robot, view in frame.views.items():
        if robot not in frame.helpers:
            return Cloud(*view)
    return None


def _sds(found: Boxes) -> Floats:
    """How far boxes' middles are off along an axis: standard deviations (N,), metres."""
    return SURE_SD_M + DOUBT_SD_M * (1.0 - found.scores)


def _turned_sds(found: Boxes) -> Floats:
    """How far boxes' headings are off: standard deviations (N,), rad."""
    return SURE_RAD + DOUBT_RAD * (1.0 - found.scores)


def _square(boxes: Boxes) -> NDArray[np.bool_]:
    long, wide = boxes.sizes[:, 0], boxes.sizes[:, 1]
    square: NDArray[np.bool_] = np.abs(long - wide) <= SQUARE * np.maximum(long, wide)
    return square


def _pooled(remembered: float, seen: float, weight: float) -> float:
    first, second = (np.log(p / (1.0 - p)) for p in np.clip([remembered, seen], CLIP, 1.0 - CLIP))
    return float(1.0 / (1.0 + np.exp(-((1.0 - weight) * first + weight * second))))
