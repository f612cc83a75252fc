"""`coadapt wish --batch`: what cannot be read is named before any model is loaded."""

from __future__ import annotations

from pathlib import Path

import pytest

from coadapt.wish_batch import understood_batch
from swarm.errors import DecisionError

GOOD = '{"id": 1, "wish": "leave R3 alone", "robots": ["R3"], "now": "2027-01-15T12:00:00+01:00"}'


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("{", "truncated"),
        ('{"id": 1}', "wish"),
        ('{"wish": "leave R3 alone"}', "id"),
        ('{"id": 1, "wish": "x", "robots": ["R 3"]}', "robots"),
        ('{"id": 1, "wish": "x", "places": ["a\\u0000b"]}', "places"),
        ('{"id": 1, "wish": "x", "now": "noon"}', "now"),
        ('{"id": 1, "wish": "x", "now": "2027-01-15T12:00:00"}', "now"),
    ],
)
def test_a_line_that_cannot_be_read_is_named(tmp_path: Path, line: str, named: str) -> None:
    path = tmp_path / "wishes.jsonl"
    path.write_text(f"{GOOD}\n\n{line}\n")
    with pytest.raises(DecisionError, match=rf"line 3 is not valid: .*{named}"):
        next(understood_batch(path))


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DecisionError, match="cannot be read"):
        next(understood_batch(tmp_path / "none.jsonl"))
