"""What code says of an intent holds every field of it, and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from swarm.intent_words import effect_in_words, in_words
from swarm.messages import Effect, Expected, intent_from_json


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "nothing"),
        ({"unclear": ["hello?"]}, "nothing"),
        ({"until": "2027-01-15T18:00:00+01:00"}, "nothing"),
        ({"exclude": ["R1", "R2", "R3"]}, "leave R1, R2 and R3 out"),
        ({"only": []}, "ask nobody"),
        ({"only": ["R1", "R2"]}, "ask nobody but R1 and R2"),
        ({"prefer": ["R5"]}, "rather ask R5"),
        ({"focus": [{"place": "Tor 4", "weight": "low"}]}, "Tor 4 counts less"),
        ({"classes": {"person": "high"}}, "person counts more"),
        ({"q_min": 0.85}, "quality at least 0.85 where that can be reached"),
        ({"link_share": 0.125}, "use at most 12.5 % of the link"),
        ({"save": "compute"}, "save compute"),
        ({"policy": "rules"}, "decide by rules"),
        (
            {
                "save": "bandwidth",
                "start": "2027-01-15T08:00:30-03:30",
                "until": "2027-01-15T18:00:00Z",
            },
            "save bandwidth; from 2027-01-15 08:00:30 -03:30; until 2027-01-15 18:00 +00:00",
        ),
    ],
)
def test_every_field_is_read_back(given: dict[str, Any], said: str) -> None:
    assert in_words(intent_from_json(given)) == said


def test_an_effect_is_told_in_sentences() -> None:
    before = Expected(
        participants=2.0,
        robots={"R2": 1.0, "R3": 1.0},
        bytes_s=5e4,
        quality=0.75,
        seen={"docks": 0.5},
    )
    after = Expected(
        participants=1.0, robots={"R2": 1.0}, bytes_s=2e4, quality=0.7, seen={"docks": 0.25}
    )
    effect = Effect(
        decisions=20, span_s=57.0, policy="coverage", before=before, after=after, nobody=True
    )
    assert effect_in_words(effect) == [
        "over the last 57 s (20 decisions by coverage): 2.0 -> 1.0 participants, "
        "50.0 -> 20.0 kB/s, Q 0.75 -> 0.70",
        "docks: 50 -> 25 % of what all see there",
        "R3 takes part in 100 -> 0 % of them",
        "it leaves NOBODY TO ASK: the ego goes on alone",
    ]
    assert effect_in_words(Effect(decisions=0, span_s=0.0, policy="coverage")) == [
        "not known: the ego has decided nothing in the last minute"
    ]
