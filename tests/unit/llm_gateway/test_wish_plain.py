"""Of three thousand plain wishes none is misread without a question but those marked so."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

PLAIN = Path(__file__).parents[2] / "data" / "wishes-plain.txt"
NOW = datetime.fromisoformat("2026-03-03T14:05:00+01:00")
SITE = Site(robots=("R1", "R2", "R3"), places=("docks", "aisle 1"), classes=("person", "pallet"))


def hard(intent: Intent) -> str:
    """What an intent says of hard things, as the file writes it."""
    said = {
        "out": ",".join(sorted(intent.exclude)),
        "only": "" if intent.only is None else ",".join(sorted(intent.only)) or "nobody",
        "quality": "" if intent.q_min is None else f"{intent.q_min:g}",
        "link": "" if intent.link_share is None else f"{intent.link_share:g}",
        "from": _clock(intent.start),
        "until": _clock(intent.until),
    }
    return " ".join(f"{name}={value}" for name, value in said.items() if value)


def _clock(time: str | None) -> str:
    if time is None:
        return ""
    at = datetime.fromisoformat(time)
    days = (at.date() - NOW.date()).days
    return (f"{days:+d}d" if days else "") + f"{at:%H:%M}"


def test_plain_wishes_are_read_as_meant_or_asked_about() -> None:
    lines = [
        line.split("|")
        for line in PLAIN.read_text(encoding="utf-8").splitlines()
        if line and not line.startswith("#")
    ]
    misread = []
    for meant, wish in lines:
        intent = understand(wish, SITE, NOW, None)
        as_meant = meant != "?" and hard(intent) == meant
        if not (intent.unclear or as_meant or meant.startswith("!")):
            misread.append((wish, meant, hard(intent)))
    assert len(lines) > 3000
    assert misread == []
