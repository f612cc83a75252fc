"""Several forms in one frame: near robots may send points, far ones boxes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from perception.fusion.base import EncodeOptions, Fusion, Gathering
from perception.fusion.one_pass import Form, OnePass
from swarm.errors import PerceptionError
from swarm.geometry import Matrix, Points


def mixable(fusions: Mapping[str, Fusion]) -> tuple[str, ...]:
    """Which of some fusions, by name, can be joined with others in one frame."""
    return tuple(name for name, fusion in fusions.items() if isinstance(fusion, Form))


def scored_by(sent: Iterable[str]) -> str:
    """The form whose calibration holds for the scores of a frame to which these were sent: the most
    frequent one. Raises PerceptionError for none."""
    counts = Counter(sorted(sent))
    if not counts:
        raise PerceptionError("nothing was sent: the scores are those of the ego alone")
    return counts.most_common(1)[0][0]


class Mixed(Fusion):
    """Several forms in one frame: each contribution names its own."""

    name = "mixed"

    def __init__(self, forms: Mapping[str, Fusion], sends: Mapping[str, str] | None = None) -> None:
        """`forms`: by name, of one detector. `sends`: which of them each robot sends, for whoever
        asks the robots. Raises PerceptionError for none, and for a fusion that cannot be joined
        with others."""
        alone = [name for name, form in forms.items() if not isinstance(form, Form)]
        if alone or not forms:
            raise PerceptionError(
                f"fusions {', '.join(alone) or '(none)'} cannot be mixed; allowed: those whose "
                "robots send points, maps or boxes of perception.fusion.one_pass"
            )
        self.sends = dict(sends or {})
        self.forms = {name: form for name, form in forms.items() if isinstance(form, Form)}

    def encode(self, points: Points, options: EncodeOptions) -> bytes:
        """Raises PerceptionError: a robot sends one form."""
        raise PerceptionError(f"a robot sends one form; allowed: {', '.join(self.forms)}")

    def begin(self, own: Points, world_from_own: Matrix) -> Gathering:
        """Starts a frame to which robots send any of the forms."""
        return OnePass(self.forms, own, world_from_own)
