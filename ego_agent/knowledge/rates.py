"""What contributions are worth by form and rate, where memory carries on what they showed.

The probability that what one contribution shows counts: less than 1 at any rate, since one view
does not always suffice for a box in the right place, and less at lower ones. Fitted together with
Q to random assignments on floors and streets that nothing else was set on (`coadapt eval
fit-rates`, docs/results.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from swarm.errors import DecisionError
from swarm.messages import Algorithm

RATES = Path(__file__).parent / "rates.json"
USUAL_DETECTOR = "factory"
USUAL_ALGORITHM = "intermediate"
FOCUSED = "+places"
"""What is added to an algorithm's name where the ego asks in between about the places of what it
remembers."""
Worth = Annotated[float, msgspec.Meta(ge=0, le=1)]


class RateModel(msgspec.Struct, frozen=True):
    """What each rate is worth, with one detector."""

    by_algorithm: Mapping[Algorithm, Mapping[str, Worth]]
    """By algorithm, then by contributions a second."""

    def worth(self, algorithm: Algorithm, rate_hz: float) -> float:
        """Probability that contributions at a rate count, in [0, 1]: linear in the time between
        two, and nothing for what is rarer than was measured. An algorithm that was not measured
        counts as USUAL_ALGORITHM."""
        table = self.by_algorithm.get(algorithm) or self.by_algorithm[USUAL_ALGORITHM]
        points = sorted((1.0 / float(hz), part) for hz, part in table.items())
        gaps, left = zip(*points, strict=True)
        return float(np.interp(1.0 / rate_hz, gaps, left, right=0.0))

    def focuses(self, algorithm: Algorithm) -> bool:
        """Whether it is known what contributions are worth with places asked about in between."""
        return algorithm + FOCUSED in self.by_algorithm

    def convinces(self, algorithm: Algorithm) -> float:
        """Probability that what is contributed as often as was measured counts, in [0, 1]."""
        return self.worth(algorithm, float("inf"))

    def kept(
        self, algorithm: Algorithm, rate_hz: float, usual_hz: float, *, focused: bool = False
    ) -> float:
        """The same against contributions at `usual_hz`, in [0, 1]; `focused`: with places asked
        about in between."""
        whole = self.worth(algorithm, usual_hz)
        left = self.worth(algorithm + FOCUSED if focused else algorithm, rate_hz)
        return min(1.0, left / whole) if whole > 0.0 else 0.0


def rates_of(detector: str) -> RateModel:
    """The model of a detector; one that was not measured counts as USUAL_DETECTOR."""
    models = packaged_rates()
    return models.get(detector) or models[USUAL_DETECTOR]


@cache
def packaged_rates() -> Mapping[str, RateModel]:
    """The models that come with the project, by detector."""
    return read_rates(RATES)


def read_rates(path: Path) -> Mapping[str, RateModel]:
    """The models in a file, by detector. Raises DecisionError when it cannot be read, is none, or
    lacks what stands in for everything that was not measured."""
    try:
        tables = msgspec.json.decode(path.read_bytes(), type=dict[str, dict[str, dict[str, Worth]]])
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecisionError(f"{path} is no model of rates: {error}") from error
    for detector in {USUAL_DETECTOR, *tables}:
        if not tables.get(detector, {}).get(USUAL_ALGORITHM):
            raise DecisionError(
                f"{path} has nothing of {USUAL_ALGORITHM!r} with detector {detector!r}; needed: "
                f"its worth by contributions a second"
            )
    return {detector: RateModel(table) for detector, table in tables.items()}
