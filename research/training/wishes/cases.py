"""The hand-written wishes, each with the intent that it means."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from swarm.errors import PerceptionError
from swarm.messages.intent import Intent, Site, intent_from_json

WISHES = Path(__file__).parents[3] / "tests" / "data" / "wishes.jsonl"


class Case(msgspec.Struct, frozen=True):
    """One wish, as a line of the file has it."""

    id: str
    language: str
    kind: str
    wish: str
    robots: tuple[str, ...]
    places: tuple[str, ...]
    classes: tuple[str, ...]
    now: str
    intent: dict[str, Any]
    """What it means; `unclear`: whether something must be asked back."""

    @property
    def site(self) -> Site:
        """Its names."""
        return Site(robots=self.robots, places=self.places, classes=self.classes)

    @property
    def time(self) -> datetime:
        """When it is said."""
        return datetime.fromisoformat(self.now)

    @property
    def meant(self) -> Intent:
        """The intent, without words of its `unclear`."""
        plain = {name: value for name, value in self.intent.items() if name != "unclear"}
        return intent_from_json(plain)

    @property
    def doubtful(self) -> bool:
        """Whether something must be asked back."""
        return bool(self.intent.get("unclear"))


def cases(path: Path = WISHES) -> list[Case]:
    """All of a file. Raises PerceptionError for a line that is none."""
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            found.append(msgspec.json.decode(line, type=Case))
        except msgspec.DecodeError as error:
            raise PerceptionError(f"{path}, line {number} is no wish: {error}") from error
    return found
