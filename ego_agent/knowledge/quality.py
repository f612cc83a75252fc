"""Q(P, a) as a precision: what AP@0.7 is expected where participants show a share of what there is.

An ego alone is expected to reach `base + own * s0`, where s0 is the share that it sees itself, of
what it and all candidates can see of the area that counts; participants add `gains[a]` times the
share that they add, up to `enough`. The figures of a detector are fitted to measured choices in
control windows (docs/evaluation.md); where there are none, Q is the share itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarm.errors import DecisionError
from swarm.messages import Algorithm

QUALITY = Path(__file__).parent / "quality.json"
"""The fitted figures of frames that stand for themselves, by detector."""
REMEMBERED = Path(__file__).parent / "remembered.json"
"""The same where memory carries on what was shown, and contributions may be rarer."""
USUAL_GAINS: Mapping[Algorithm, float] = {"early": 1.0, "intermediate": 0.97, "late": 0.90}
"""Where nothing was fitted: AP@0.7 relative to early, with everyone taking part."""
OTHER = "intermediate"
"""Whose gain counts for an algorithm that is not listed: other ways to fuse features."""

Part = Annotated[float, msgspec.Meta(ge=0, le=1)]


class QualityModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What precision to expect of a share, with one detector."""

    base: Part = 0.0
    """AP@0.7 of an ego that sees nothing of what others could show."""
    own: Part = 1.0
    """What is added to it for the whole share, where the ego sees it itself."""
    gains: Mapping[Algorithm, Part] = msgspec.field(default_factory=lambda: dict(USUAL_GAINS))
    """The same where participants show it, by algorithm."""
    enough: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    """A share above this counts as this: what only one robot sees at the rim brings nothing."""
    half_m: tuple[float, float] | None = None
    """Half of the area that counts along the ego's own x and y, metres; None: all that is known."""
    calibrated: bool = False
    """Whether quality is a precision; else it is a share."""

    def quality(self, algorithm: Algorithm, own: float, share: float, known: float = 1.0) -> float:
        """Q in [0, 1], where the ego sees the share `own` and all that take part see `share`, and
        of the part `known` of the living robots something is known: of nothing comes nothing."""
        own, share = min(own, self.enough), min(share, self.enough)
        added = self.gain(algorithm) * max(0.0, share - own)
        return min(1.0, self.base * known + self.own * own + added)

    def gain(self, algorithm: Algorithm) -> float:
        """Quality that participants bring by showing everything to an ego that sees nothing."""
        return self.gains.get(algorithm, self.gains.get(OTHER, self.own))

    def counts(self, offsets: NDArray[np.float64], heading: float) -> NDArray[np.bool_]:
        """Whether places count: metres from the ego along the world's x and y, (n, 2), for an ego
        of that heading, rad; bool (n,)."""
        if self.half_m is None:
            return np.ones(len(offsets), dtype=np.bool_)
        cos, sin = np.cos(heading), np.sin(heading)
        own = offsets @ np.array([[cos, -sin], [sin, cos]])
        inside: NDArray[np.bool_] = (np.abs(own) <= self.half_m).all(axis=1)
        return inside


def quality_of(detector: str, *, remembers: bool = False) -> QualityModel:
    """The model of a detector, of an ego that goes by memory or by single frames; the uncalibrated
    one where nothing was fitted for it."""
    return packaged_quality(remembers=remembers).get(detector, QualityModel())


@cache
def packaged_quality(*, remembers: bool = False) -> Mapping[str, QualityModel]:
    """The models that come with the project, by detector."""
    return read_quality(REMEMBERED if remembers else QUALITY)


def read_quality(path: Path) -> Mapping[str, QualityModel]:
    """The models in a file, by detector. Raises DecisionError when it cannot be read or holds
    something else."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, QualityModel])
    except OSError as error:
        raise DecisionError(f"quality model {path} cannot be read: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecisionError(f"quality model {path} is not one: {error}") from error
