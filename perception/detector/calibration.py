"""What a detector's scores mean: calibrated, they say how often such a box is right.

The chance that a box shows an object (IoU of the footprints of at least 0.5) is taken as logistic
in the logit of its raw score and the logarithm of the number of robots that contributed, after
Platt, "Probabilistic outputs for support vector machines" (1999), with other coefficients for each
fusion algorithm: points of six robots leave other doubts than boxes of two.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from perception.detector.weight_files import calibration_file, weight_file
from perception.types import Boxes
from swarm.errors import PerceptionError

ALONE = "single"
"""In place of an algorithm: the ego's own scan, which nobody contributed to."""
_CLIP = 1e-4
"""Raw scores are kept this far from 0 and 1."""

Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Curve(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Raw score to chance for one algorithm, and what was measured with it."""

    offset: float
    slope: Annotated[float, msgspec.Meta(gt=0)]
    """Of the raw score's logit: a better score is never worth less."""
    helpers: float
    """Of ln(1 + number of robots that contributed)."""
    precision: Share
    """At the operating point, as are recall and false boxes."""
    recall: Share
    false_per_frame: Annotated[float, msgspec.Meta(ge=0)]
    calibration_error: Share
    """Expected: the mean distance of told chance and measured share, over ten bins of the published
    boxes."""
    reliability: tuple[tuple[float, float, int], ...] = ()
    """Of each of these bins: mean chance told, share that was right, number of boxes."""
    frames: Annotated[int, msgspec.Meta(ge=1)]

    def chance(self, scores: NDArray[np.float64], helpers: int) -> NDArray[np.float64]:
        """The chance (N,) of raw scores (N,) in [0, 1]."""
        kept = np.clip(scores, _CLIP, 1.0 - _CLIP)
        logit = self.slope * np.log(kept / (1.0 - kept)) + self.offset
        logit += self.helpers * math.log1p(helpers)
        chance: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-logit))
        return chance


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The curves of one detector and its operating point."""

    detector: str
    weights: str
    """Beginning of the SHA-256 of the weights' file that it was made for."""
    least_chance: Share
    """The operating point: boxes of a smaller chance are not published."""
    curves: dict[str, Curve]
    """By algorithm, and ALONE."""

    def published(self, found: Boxes, algorithm: str, helpers: int) -> Boxes:
        """The boxes above the operating point, best first, with their chance as score.

        `helpers`: robots whose contribution is in them. An algorithm that nobody has calibrated
        keeps all its boxes with their own scores.
        """
        if algorithm not in self.curves:
            return found
        return self.judged(found, algorithm, helpers).above(self.least_chance)

    def judged(self, found: Boxes, algorithm: str, helpers: int) -> Boxes:
        """All boxes, best first, with their chance as score. Raises KeyError for an algorithm that
        nobody has calibrated."""
        chance = self.curves[algorithm if helpers else ALONE].chance(found.scores, helpers)
        return replace(found, scores=chance).take(np.argsort(-chance, kind="stable"))


def uncalibrated(detector: str) -> Calibration:
    """That publishes all boxes with their own scores: of a detector without a calibration."""
    return Calibration(detector=detector, weights="", least_chance=0.0, curves={})


@cache
def calibration_of(detector: str) -> Calibration:
    """The calibration that comes with a detector's weights; `uncalibrated` where none does.

    Raises PerceptionError for a file that is none, or was made for other weights.
    """
    path, weights = calibration_file(detector), weight_file(detector)
    if not path.is_file() or not weights.is_file():
        return uncalibrated(detector)
    return read_calibration(path, detector, weights)


def read_calibration(path: Path, detector: str, weights: Path) -> Calibration:
    """The calibration in a file. Raises PerceptionError as `calibration_of` does."""
    try:
        found = msgspec.json.decode(path.read_bytes(), type=Calibration)
    except (OSError, msgspec.DecodeError) as error:
        raise PerceptionError(f"calibration {path} cannot be used: {error}") from error
    if ALONE not in found.curves:
        raise PerceptionError(f"calibration {path} cannot be used: it has no curve {ALONE!r}")
    made_for = (found.detector, found.weights)
    if made_for != (detector, digest_of(weights)):
        raise PerceptionError(
            f"calibration {path} was made for other weights than {weights}; make it again "
            f"(coadapt train --config {detector} --calibrate), or remove it to publish all boxes "
            "with their own scores"
        )
    return found


def digest_of(weights: Path) -> str:
    """What a calibration knows the weights' file by."""
    return hashlib.sha256(weights.read_bytes()).hexdigest()[:16]
