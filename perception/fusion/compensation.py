"""Fusing contributions that were captured at other times than the ego's newest scan.

Each contribution is fused with the ego's own scan of its time, so that everything that is laid over
each other was captured together, whatever the algorithm sends. What is found there is moved to the
present with the objects' own velocities, and joined with what the ego and the timely contributions
show now.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from perception.boxes import SHARPNESS, weighted_fusion
from perception.detector.config import configuration
from perception.fusion.aligner import Remembering
from perception.fusion.base import Contribution, FrameRequest, Fusion, Gathering
from perception.fusion.tracks import Tracks
from perception.jumps import Whereabouts
from perception.types import Boxes
from swarm.errors import PayloadError
from swarm.geometry import Matrix, Points, invert, transform

KEPT_SCANS = 12
FADES_S = 0.7
"""In this time a box that is moved with its object loses two thirds of its weight."""
MAX_APART_S = 0.5
"""A contribution farther in time from all of the ego's scans cannot be fused."""


@dataclass(frozen=True, slots=True)
class OwnScan:
    """A scan of the ego."""

    time_s: float
    """Capture, seconds of the ego's clock."""
    points: Points
    """float32 (N, 3) in the sensor's frame."""
    world_from_own: Matrix


class MotionCompensation:
    """What an ego remembers from frame to frame: its scans of late, and how objects move."""

    def __init__(
        self, detector: str, timely_s: float = 0.0, poses: Remembering | None = None
    ) -> None:
        """`detector`: the world's detector configuration. Raises PerceptionError for an unknown
        one. `timely_s`: contributions this much older or newer than the ego's scan are fused with
        it all the same: each other time takes another pass through the detector. `poses`: by what
        senders' poses are off; None: each frame estimates it anew."""
        self._poses = poses
        self._timely_s = timely_s
        self._tracks = Tracks(configuration(detector).usual_speed_m_s)
        self._scans: deque[OwnScan] = deque(maxlen=KEPT_SCANS)
        self._whereabouts = Whereabouts()

    def remember(self, own: OwnScan) -> None:
        """Keeps a scan that contributions of its time may be fused with."""
        back = bool(self._scans) and own.time_s <= self._scans[-1].time_s
        if back:
            # The clock was put back: what is remembered lies in the future.
            self._whereabouts.forget()
        if self._whereabouts.jumps(own.time_s, own.world_from_own) or back:
            self._scans.clear()
            self._tracks.clear()
        self._scans.append(own)

    def begin(self, fusion: Fusion, own: OwnScan) -> Gathering:
        """Starts a frame. Contributions tell by `age_s` how long before `own` they were captured;
        each is fused with the ego's scan nearest to that."""
        self.remember(own)
        return _Compensated(fusion, tuple(self._scans), self._tracks, self._timely_s, self._poses)


class _Compensated(Gathering):
    """A gathering for the present and one for each past scan that a contribution belongs to."""

    def __init__(
        self,
        fusion: Fusion,
        scans: tuple[OwnScan, ...],
        tracks: Tracks,
        timely_s: float,
        poses: Remembering | None,
    ) -> None:
        self._fusion = fusion
        self._poses = poses
        self._scans = scans
        self._own = scans[-1]
        self._timely_s = timely_s
        self._tracks = tracks
        self._now = self._begun(self._own.points, self._own.time_s)
        self._gatherings = {len(scans) - 1: self._now}
        self._views = [1] * len(scans)
        """Robots that show each scan's time, the ego included."""

    def ask(self) -> FrameRequest:
        return self._now.ask()

    def ask_for(self, form: str) -> FrameRequest:
        return self._now.ask_for(form)

    def prepare(self) -> None:
        self._now.prepare()

    def add(self, contribution: Contribution) -> None:
        timely = abs(contribution.age_s) <= self._timely_s
        captured_s = self._own.time_s - (0.0 if timely else contribution.age_s)
        # The newest of those that are as near, to the millisecond.
        nearest = min(
            reversed(range(len(self._scans))),
            key=lambda i: round(abs(self._scans[i].time_s - captured_s), 3),
        )
        apart_s = abs(self._scans[nearest].time_s - captured_s)
        if apart_s > MAX_APART_S:
            raise PayloadError(
                f"the contribution was captured {contribution.age_s:.1f} s before the ego's scan, "
                f"{apart_s:.1f} s from any that the ego keeps; allowed: {MAX_APART_S}"
            )
        gathering = self._gatherings.get(nearest) or self._begin_at(self._scans[nearest])
        gathering.add(contribution)
        self._gatherings[nearest] = gathering
        self._views[nearest] += 1

    def finish(self) -> Boxes:
        most = max(self._views)
        parts = []
        for index, gathering in sorted(self._gatherings.items()):
            boxes, scan = gathering.finish(), self._scans[index]
            if scan is not self._own:
                boxes = self._at_present(boxes, scan.time_s)
            elif len(self._gatherings) == 1:
                self._tracks.update(boxes, scan.time_s)
                return boxes
            # The more robots have seen an object, the nearer they come; the longer ago, the less.
            ago_s = self._own.time_s - scan.time_s
            trust = math.sqrt(self._views[index] / most) * math.exp(-ago_s / FADES_S)
            scores = boxes.scores * trust ** (1 / SHARPNESS)
            parts.append(replace(boxes, scores=scores))
        # The ego's own eyes are in each of them.
        return weighted_fusion(Boxes.concatenate(parts), independent=False)

    def corrections(self) -> dict[str, Matrix]:
        found: dict[str, Matrix] = {}
        for gathering in self._gatherings.values():
            found |= gathering.corrections()
        return found

    def left_out(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for gathering in self._gatherings.values():
            found |= gathering.left_out()
        return found

    def sent_points(self) -> dict[str, tuple[Points, Matrix]]:
        # What is older shows another moment.
        return self._now.sent_points()

    def _begin_at(self, scan: OwnScan) -> Gathering:
        """As if the ego had stood then where it stands now: that is the frame it asked for."""
        here = self._own.world_from_own
        here_from_then = invert(here) @ scan.world_from_own
        gathering = self._begun(transform(here_from_then, scan.points), scan.time_s)
        gathering.stood_at = (float(here_from_then[0, 3]), float(here_from_then[1, 3]))
        return gathering

    def _begun(self, points: Points, time_s: float) -> Gathering:
        """A gathering where the ego stands now, for what was captured at that time."""
        here = self._own.world_from_own
        gathering = self._fusion.begin(points, here)
        if self._poses is not None:
            gathering.remembered = self._poses.at(time_s, self._own.time_s, here)
        return gathering

    def _at_present(self, boxes: Boxes, time_s: float) -> Boxes:
        centers = boxes.centers.copy()
        centers[:, :2] += self._tracks.update(boxes, time_s) * (self._own.time_s - time_s)
        return replace(boxes, centers=centers)
