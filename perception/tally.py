"""Gathers detections of many frames, of one world or of several, and scores them together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from perception.metrics import Match, match, precision_of
from perception.types import Boxes

IOUS = (0.3, 0.5, 0.7)
ALL = ""
"""In place of a class: all boxes, whatever they are called."""
WITH_KNOWN = "with-known"
"""In place of a class: all boxes, and the robots of which beacons tell."""
CLASS_KEYS = ("ap_50", "ap_70", "ground_truth")
"""Of `Precision`: what is told of a class."""
OPERATING_IOU = 0.5
"""From which a published box is right."""


@dataclass(frozen=True, slots=True)
class Precision:
    """Scores of one algorithm over all frames, of objects that no beacon tells."""

    ap_30: float
    ap_50: float
    ap_70: float
    ap_70_per_frame: float
    """Ranked within frames, as OpenCOOD's published tables are (perception.metrics)."""
    ap_70_with_known: float
    """Of known robots, too."""
    precision: float
    """Of the published boxes, at OPERATING_IOU; as are recall and false boxes."""
    recall: float
    false_per_frame: float
    bytes_per_robot_frame: float
    frames: int
    ground_truth: int

    def figures(self, *names: str) -> dict[str, float]:
        """These, or all, by name, rounded to four digits."""
        return {name: round(getattr(self, name), 4) for name in names or self.__slots__}


@dataclass(slots=True)
class Tally:
    """Matches of one algorithm, frame by frame, for the boxes as a whole and for each class."""

    frames: int = 0
    sizes: list[int] = field(default_factory=list)
    """Bytes of each contribution."""
    _matches: dict[tuple[str, float], list[Match]] = field(default_factory=dict)

    def add(
        self,
        found: Boxes,
        truth: Boxes,
        sizes: Iterable[int],
        with_known: tuple[Boxes, Boxes] | None = None,
    ) -> None:
        """One frame: its detected boxes, its true ones, and the bytes of its contributions.
        `with_known`: the same boxes with those of known robots; as before where there are none."""
        self.frames += 1
        self.sizes += sizes
        for iou in IOUS:
            matched = match(*(with_known or (found, truth)), iou)
            self._matches.setdefault((WITH_KNOWN, iou), []).append(matched)
        for label in (ALL, *sorted({*found.labels, *truth.labels})):
            mine, theirs = (_of_class(boxes, label) for boxes in (found, truth))
            for iou in IOUS:
                self._matches.setdefault((label, iou), []).append(match(mine, theirs, iou))

    def packed(self) -> dict[str, Any]:
        """What `unpacked` restores, as plain values."""
        return {
            "frames": self.frames,
            "sizes": self.sizes,
            "matches": [
                [label, iou, [[m.scores.tobytes(), m.hits.tobytes(), m.truths] for m in matches]]
                for (label, iou), matches in self._matches.items()
            ],
        }

    @classmethod
    def unpacked(cls, values: dict[str, Any]) -> Tally:
        """The tally whose `packed` gave these values."""
        tally = cls(values["frames"], values["sizes"])
        for label, iou, matches in values["matches"]:
            tally._matches[label, iou] = [
                Match(np.frombuffer(scores), np.frombuffer(hits, np.bool_), truths)
                for scores, hits, truths in matches
            ]
        return tally

    def take_up(self, other: Tally) -> None:
        """Appends the frames of another tally."""
        self.frames += other.frames
        self.sizes += other.sizes
        for key, matches in other._matches.items():
            self._matches.setdefault(key, []).extend(matches)

    def precision(self, label: str = ALL, *, per_frame: bool = False) -> Precision:
        """AP of all frames together; `per_frame`: ranked as OpenCOOD does (perception.metrics).

        A box counts as found whatever class it was given, unless `label` asks for one.
        """

        def ap(iou: float, of: str = label, per_frame: bool = per_frame) -> float:
            return precision_of(self._matches.get((of, iou), []), per_frame=per_frame)

        judged = self._matches.get((label, OPERATING_IOU), [])
        published = sum(len(one.hits) for one in judged)
        right = sum(int(one.hits.sum()) for one in judged)
        truths = sum(one.truths for one in judged)
        return Precision(
            ap_30=ap(0.3),
            ap_50=ap(0.5),
            ap_70=ap(0.7),
            ap_70_per_frame=ap(0.7, per_frame=True),
            ap_70_with_known=ap(0.7, WITH_KNOWN) if label == ALL else 0.0,
            precision=right / published if published else 0.0,
            recall=right / truths if truths else 0.0,
            false_per_frame=(published - right) / self.frames if self.frames else 0.0,
            bytes_per_robot_frame=float(np.mean(self.sizes)) if self.sizes else 0.0,
            frames=self.frames,
            ground_truth=truths,
        )

    def classes(self, *, per_frame: bool = False) -> dict[str, Precision]:
        """The same of each class that true boxes have: there a box must have the right class."""
        labels = sorted(
            label
            for (label, iou), matches in self._matches.items()
            if label not in (ALL, WITH_KNOWN)
            and iou == OPERATING_IOU
            and any(one.truths for one in matches)
        )
        return {label: self.precision(label, per_frame=per_frame) for label in labels}


def _of_class(boxes: Boxes, label: str) -> Boxes:
    if label == ALL:
        return boxes
    return boxes.take(np.array([name == label for name in boxes.labels], dtype=np.bool_))
