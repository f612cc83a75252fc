"""Many wishes at once, without a swarm: by the embedded model, on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Annotated

import msgspec

from swarm.errors import DecisionError, GatewayError
from swarm.messages import Intent, Site, intent_to_json
from swarm.messages.intent import MAX_WISH_CHARS, Name, Robots


class _Line(msgspec.Struct, frozen=True):
    id: str | int
    wish: str
    robots: Robots = ()
    places: tuple[Name, ...] = ()
    classes: tuple[Name, ...] = ()
    now: Annotated[datetime, msgspec.Meta(tz=True)] | None = None


def understood_batch(path: Path) -> Iterator[str]:
    """A JSON object for each line of the file: its `id` and the `intent`.

    What the model gives no answer to is not understood: an empty intent with the wish in `unclear`.
    Raises DecisionError for a file or line that is not as it must be, before anything is
    understood, and SettingError where the model is not installed.
    """
    # Only here: no other wish needs the model in this process.
    from llm_gateway.wishes import understand
    from llm_gateway.wishes.readers import embedded_reader

    lines = list(_lines(path))
    with embedded_reader() as reader:
        for line in lines:
            site = Site(robots=line.robots, places=line.places, classes=line.classes)
            now = line.now or datetime.now().astimezone()
            try:
                intent = understand(line.wish, site, now, reader)
            except GatewayError:
                intent = Intent(unclear=(line.wish[:MAX_WISH_CHARS],), model=reader.model)
            told = {"id": line.id, "intent": intent_to_json(intent)}
            yield msgspec.json.encode(told).decode()


def _lines(path: Path) -> Iterator[_Line]:
    try:
        raw = path.read_bytes().splitlines()
    except OSError as error:
        raise DecisionError(f"--batch {str(path)!r} cannot be read: {error}") from error
    for number, line in enumerate(raw, start=1):
        if not line.strip():
            continue
        try:
            yield msgspec.json.decode(line, type=_Line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise DecisionError(f"{path} line {number} is not valid: {error}") from error
