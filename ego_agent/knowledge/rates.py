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
Worth = Annotated[float, msgspec.Meta(ge=0, le=1)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=1000)]


class RateModel(msgspec.Struct, frozen=True):
    """What each rate is worth, with one detector."""

    by_algorithm: Mapping[Algorithm, Mapping[str, Worth]]
    """By algorithm, then by contributions a second."""
    with_places: Mapping[Algorithm, Mapping[str, Worth]] = msgspec.field(default_factory=dict)
    """The same where the ego asks in between about the places of what it remembers..."""
    places_hz: Mapping[str, Rate] = msgspec.field(default_factory=dict)
    """...so often, by contributions a second."""

    def worth(self, algorithm: Algorithm, rate_hz: float) -> float:
        """Probability that contributions at a rate count, in [0, 1]: linear in the time between
        two, and nothing for what is rarer than was measured. An algorithm that was not measured
        counts as USUAL_ALGORITHM."""
        return _worth(
            self.by_algorithm.get(algorithm) or self.by_algorithm[USUAL_ALGORITHM], rate_hz
        )

    def between_hz(self, algorithm: Algorithm, rate_hz: float) -> float:
        """How often places must be asked about in between for what contributions at that rate are
        worth then, as at the next lower rate that was measured; 0: that is not known."""
        measured = sorted((float(hz), often) for hz, often in self.places_hz.items())
        if not self.with_places.get(algorithm) or not measured or rate_hz > measured[-1][0]:
            return 0.0
        return max([pair for pair in measured if pair[0] <= rate_hz] or measured[:1])[1]

    def convinces(self, algorithm: Algorithm) -> float:
        """Probability that what is contributed as often as was measured counts, in [0, 1]."""
        return self.worth(algorithm, float("inf"))

    def kept(
        self, algorithm: Algorithm, rate_hz: float, usual_hz: float, *, focused: bool = False
    ) -> float:
        """The same against contributions at `usual_hz`, in [0, 1]; `focused`: with places asked
        about in between, where that was measured."""
        whole = self.worth(algorithm, usual_hz)
        table = self.with_places.get(algorithm) if focused else None
        left = _worth(table, rate_hz) if table else self.worth(algorithm, rate_hz)
        return min(1.0, left / whole) if whole > 0.0 else 0.0


def _worth(table: Mapping[str, float], rate_hz: float) -> float:
    points = sorted((1.0 / float(hz), part) for hz, part in table.items())
    gaps, left = zip(*points, strict=True)
    return float(np.interp(1.0 / rate_hz, gaps, left, right=0.0))


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
        models = msgspec.json.decode(path.read_bytes(), type=dict[str, RateModel])
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecisionError(f"{path} is no model of rates: {error}") from error
    for detector in {USUAL_DETECTOR, *models}:
        model = models.get(detector)
        if model is None or not model.by_algorithm.get(USUAL_ALGORITHM):
            raise DecisionError(
                f"{path} has nothing of {USUAL_ALGORITHM!r} with detector {detector!r}; needed: "
                f"its worth by contributions a second"
            )
    return models
