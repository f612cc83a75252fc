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
    objects_from_hz: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 0.0
    """Contributions a second from which on, with places in between, only points that may be objects
    are asked for; 0: always all points."""

    def objects_suffice(self, algorithm: Algorithm, rate_hz: float, places_hz: float) -> bool:
        """Whether points that may be objects are enough of contributions at a rate, with places
        asked about so often in between: as often as was measured, since that confirms what is
        new."""
        if not 0.0 < self.objects_from_hz <= rate_hz < places_hz:
            return False
        return places_hz >= self.between_hz(algorithm, rate_hz)

    def worth(self, algorithm: Algorithm, rate_hz: float) -> float:
        """Probability that contributions at a rate count, in [0, 1]: linear in the time between
        two, and nothing for what is rarer than was measured. An algorithm that was not measured
        counts as USUAL_ALGORITHM."""
        return _worth(
            self.by_algorithm.get(algorithm) or self.by_algorithm[USUAL_ALGORITHM], rate_hz
        )

    def between_hz(self, algorithm: Algorithm, rate_hz: float) -> float:
        """How often places must be asked about in between for what contributions at that rate are
        worth then: as at the next higher rate that was measured; 0 where that is not known."""
        table = self.with_places.get(algorithm, {})
        known = sorted((float(hz), self.places_hz[hz]) for hz in table)
        if not known or rate_hz < known[0][0]:
            return 0.0
        return next((often for hz, often in known if hz >= rate_hz), 0.0)

    def convinces(self, algorithm: Algorithm) -> float:
        """Probability that what is contributed as often as was measured counts, in [0, 1]."""
        return self.worth(algorithm, float("inf"))

    def kept(
        self, algorithm: Algorithm, rate_hz: float, usual_hz: float, places_hz: float = 0.0
    ) -> float:
        """The same against contributions at `usual_hz`, in [0, 1]; `places_hz`: how often places
        are asked about in between. Where that is less often than was measured, as much less of what
        it adds."""
        whole, left = self.worth(algorithm, usual_hz), self.worth(algorithm, rate_hz)
        measured_hz = self.between_hz(algorithm, rate_hz)
        if rate_hz < min(places_hz, measured_hz):
            most = max(left, _worth(self.with_places[algorithm], rate_hz))
            part = min(1.0, (places_hz - rate_hz) / (measured_hz - rate_hz))
            left += part * (most - left)
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
    """The models in a file, by detector. Raises DecisionError when it cannot be read, is none,
    lacks what stands in for everything that was not measured, or does not say how often places were
    asked about."""
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
        for algorithm, table in model.with_places.items():
            for hz in table.keys() - model.places_hz.keys():
                raise DecisionError(
                    f"{path} has {algorithm!r} with places at {hz} Hz with detector {detector!r}, "
                    f"and no places_hz for that rate; it has {', '.join(model.places_hz) or 'none'}"
                )
    return models
