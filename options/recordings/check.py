"""Does a recording replay to what was recorded? Every recorded frame is fused again."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from options.recordings.format import FUSED, Box, Fused, KnownBox
from options.recordings.world import RecordingWorld
from perception.fusion.known import KnownRobot
from perception.fusion.mixed import scored_by
from perception.fusion.publishing import publish
from perception.types import Boxes
from swarm.body import Body
from swarm.errors import PerceptionError, RecordingError, WorldError
from swarm.geometry import Pose
from worlds.cooperative.corrected import Corrected
from worlds.cooperative.fusing import fuse_frame

TOLERANCE = 1e-3
"""Metres, radians and score; messages carry float32."""
MAX_APART_FRAMES = 0.5
"""An observation farther than this from the ego's scan is not of the recorded frame; nearer, it is
only by what the clocks are apart."""


class Difference(msgspec.Struct, frozen=True):
    """A frame that came out otherwise."""

    frame: int
    """The recorded swarm's number."""
    algorithm: str
    why: str


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """What came of fusing again."""

    compared: int
    equal: int
    """Frames with the same boxes, labels and scores within TOLERANCE."""
    boxes: int
    """Recorded boxes in the compared frames."""
    largest: float
    """Difference within the equal frames: metres, radians or score."""
    without_scans: int
    """Fused frames whose scans were not recorded."""
    other_times: int = 0
    """Fused frames in which a robot answered with its scan before or after the recorded one."""
    about_places: int = 0
    """Fused frames in which a robot sent only what it saw in the places of what was remembered, or
    only what may be objects: which of its points that were is not recorded."""
    different: tuple[Difference, ...]


def check(world: RecordingWorld, progress: Callable[[int, int], None] | None = None) -> Check:
    """Fuses every recorded frame again, with those who took part and by the same algorithm.

    Raises RecordingError when there is nothing to compare.
    """
    fused = world.file.messages(FUSED, Fused)
    known = [(one, world.frame_of(one.frame)) for one in fused]
    with_scans = [(one, frame) for one, frame in known if frame is not None]
    if not with_scans:
        raise RecordingError(
            f"recording {world.file.path} has no fused frame with scans: nothing can be compared"
        )
    allowed_ms = MAX_APART_FRAMES * 1e3 / (world.file.header.rate_hz or world.rate_hz)
    whole = [(one, frame) for one, frame in with_scans if not (one.focused or one.objects_only)]
    of_one_time = [
        (one, frame)
        for one, frame in whole
        if all(abs(age_ms) <= allowed_ms for age_ms in one.ages_ms.values())
    ]
    equal, boxes, largest = 0, 0, 0.0
    different: list[Difference] = []
    for done, (one, frame) in enumerate(of_one_time, start=1):
        boxes += len(one.boxes)
        apart = _apart(world, one, frame)
        if isinstance(apart, str):
            different.append(Difference(one.frame, one.algorithm, apart))
        else:
            equal += 1
            largest = max(largest, apart)
        if progress is not None:
            progress(done, len(of_one_time))
    return Check(
        compared=len(of_one_time),
        equal=equal,
        boxes=boxes,
        largest=largest,
        without_scans=len(known) - len(with_scans),
        other_times=len(whole) - len(of_one_time),
        about_places=len(with_scans) - len(whole),
        different=tuple(different),
    )


def _apart(world: RecordingWorld, one: Fused, frame: int) -> float | str:
    """The largest difference, or in words why they are not the same."""
    if one.known is None:
        return "it was recorded before known robots were told apart from boxes"
    try:
        fused = fuse_frame(
            world,
            frame,
            one.ego,
            one.participants,
            one.algorithm,
            forms=one.forms,
            poses=Corrected(one.corrections),
        )
        scored_as = scored_by(one.forms.values()) if one.forms else one.algorithm
        helpers = len(one.participants) - 1
        known = [_known(box) for box in one.known]
        again = publish(fused.found, world.detector, scored_as, helpers, known)
    except (PerceptionError, WorldError) as error:
        return str(error)
    if len(again) != len(one.boxes):
        return f"{len(one.boxes)} boxes were recorded, {len(again)} come out"
    if not len(again):
        return 0.0
    recorded, found = _table(one.boxes), _table(_boxes(again))
    # Equal boxes may come in another order.
    gaps = np.abs(recorded[:, None, :3] - found[None, :, :3]).max(axis=2)
    partner = gaps.argmin(axis=1)
    if len(set(partner.tolist())) != len(recorded):
        return (
            f"{gaps.min(axis=1).max():.3g} m between a recorded box and the nearest that comes out"
        )
    delta = np.abs(recorded - found[partner])
    delta[:, 6] = np.minimum(delta[:, 6], np.abs(2 * np.pi - delta[:, 6]))
    largest = float(delta.max())
    if largest > TOLERANCE:
        return f"boxes differ by {largest:.3g} (metres, radians or score)"
    labels = [again.labels[place] for place in partner]
    if labels != [box.label for box in one.boxes]:
        return "boxes have other labels"
    return largest


def _known(box: KnownBox) -> KnownRobot:
    """A robot as the ego knew it then."""
    x, y, z = box.center
    body = Body(label=box.label, size=box.size, center=(0.0, 0.0, 0.0))
    return KnownRobot(box.robot, body, Pose(x, y, z, yaw=box.heading).matrix(), box.age_s)


def _table(found: Iterable[Box]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(N, 8): centre, size, heading, score."""
    rows = [(*box.center, *box.size, box.heading, box.score) for box in found]
    return np.array(rows, dtype=np.float64).reshape(-1, 8)


def _boxes(found: Boxes) -> list[Box]:
    rows = zip(
        found.centers.tolist(),
        found.sizes.tolist(),
        found.headings.tolist(),
        found.scores.tolist(),
        found.labels,
        strict=True,
    )
    return [
        Box(center=tuple(c), size=tuple(s), heading=h, score=score, label=label)
        for c, s, h, score, label in rows
    ]
