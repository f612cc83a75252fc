"""An ego's detections, as a recording holds them."""

from __future__ import annotations

import numpy as np

from options.recordings import format as layout
from options.recordings import shapes
from options.ros.fused import remembered
from swarm.arrays import unpack_finite
from swarm.errors import MessageError
from swarm.messages import Detections, Tracks


def fused_of(message: Detections) -> layout.Fused:
    """The recorded form of an ego's detections. Raises MessageError for arrays that are none."""
    table = unpack_finite(message.boxes, "boxes", 7).astype(np.float64).tolist()
    scores = unpack_finite(message.scores, "scores", 1)[:, 0].astype(np.float64).tolist()
    if not len(table) == len(scores) == len(message.labels):
        raise MessageError(
            f"detections of frame {message.frame} have {len(table)} boxes, {len(scores)} scores "
            f"and {len(message.labels)} labels"
        )
    if message.capture_ns > shapes.LATEST_NS:
        raise MessageError(
            f"detections of frame {message.frame} are of {message.capture_ns} ns; a recording's "
            f"times end at {shapes.LATEST_NS} ns"
        )
    return layout.Fused(
        ego=message.ego,
        cycle=message.cycle,
        frame=message.frame,
        capture_ns=message.capture_ns,
        algorithm=message.algorithm,
        forms=dict(message.forms),
        ages_ms=dict(message.ages_ms),
        corrections=message.corrections,
        focused=message.focused,
        objects_only=message.objects_only,
        participants=message.participants,
        missing=dict(message.missing),
        bytes=dict(message.bytes),
        latency_ms=message.latency_ms,
        boxes=tuple(
            layout.Box(
                center=(row[0], row[1], row[2]),
                size=(row[3], row[4], row[5]),
                heading=row[6],
                label=label,
                score=score,
            )
            for row, score, label in zip(table, scores, message.labels, strict=True)
        ),
        known=tuple(
            layout.KnownBox(
                center=one.center,
                size=one.size,
                heading=one.heading,
                label=one.label,
                robot=one.robot,
                age_s=one.age_s,
                doubt=one.doubt,
            )
            for one in message.known
        ),
        tracks=None if message.tracks is None else _tracks(message.tracks),
    )


def _tracks(tracks: Tracks) -> tuple[layout.Track, ...]:
    return tuple(
        layout.Track(
            center=one.center,
            size=one.size,
            heading=one.heading,
            label=one.label,
            score=one.score,
            id=int(one.id),
            velocity=one.velocity,
            age_s=one.age_s,
        )
        for one in remembered(tracks)
    )
