"""What the work of a fused frame takes: measured beforehand, by `make bench BENCHMARKS=compute`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from swarm.errors import DecisionError

PACKAGED = Path(__file__).parent / "compute.json"
USUAL_DETECTOR = "factory"
USUAL_ALGORITHM = "intermediate"
SINGLE = "single"
"""The ego alone, whatever the algorithm."""
Milliseconds = Annotated[float, msgspec.Meta(ge=0, le=1e6)]


class Work(msgspec.Struct, frozen=True):
    """Milliseconds of one processor."""

    encode_ms: Milliseconds
    """A robot's, for one observation."""
    fixed_ms: Milliseconds
    """The ego's for a frame, whoever takes part."""
    add_ms: Milliseconds
    """The ego's for each contribution."""

    def ego_ms(self, contributions: int) -> float:
        """The ego's for a frame with that many contributions."""
        return self.fixed_ms + contributions * self.add_ms


class ComputeModel(msgspec.Struct, frozen=True):
    """What algorithms cost on one machine."""

    machine: str
    """Its processor, in words."""
    detectors: dict[str, dict[str, Work]]
    """By detector, then by algorithm; SINGLE is the ego alone."""

    def work(self, detector: str, algorithm: str) -> Work:
        """What a frame costs with that algorithm.

        One that was not measured counts as USUAL_ALGORITHM, such a detector as USUAL_DETECTOR.
        """
        measured = self.detectors.get(detector) or self.detectors[USUAL_DETECTOR]
        return measured.get(algorithm) or measured[USUAL_ALGORITHM]


def read_compute(path: Path) -> ComputeModel:
    """The model in a JSON file; keys of other names play no part.

    Raises DecisionError when the file cannot be read, is no model, or lacks what stands in for
    everything that was not measured.
    """
    try:
        model = msgspec.json.decode(path.read_bytes(), type=ComputeModel)
    except (OSError, msgspec.DecodeError) as error:
        raise DecisionError(f"{path} is no model of compute: {error}") from error
    if USUAL_DETECTOR not in model.detectors:
        raise DecisionError(
            f"{path} has the detectors {', '.join(model.detectors) or 'none'}; "
            f"needed: {USUAL_DETECTOR}"
        )
    for detector, algorithms in model.detectors.items():
        for needed in (USUAL_ALGORITHM, SINGLE):
            if needed not in algorithms:
                raise DecisionError(
                    f"{path}: detector {detector!r} has the algorithms "
                    f"{', '.join(algorithms) or 'none'}; needed: {needed}"
                )
    return model


@cache
def packaged_compute() -> ComputeModel:
    """The model that comes with the project. Raises DecisionError as `read_compute` does."""
    return read_compute(PACKAGED)
