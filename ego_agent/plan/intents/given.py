"""The intents that an ego has been given: kept across restarts, ended when their time is over."""

from __future__ import annotations

import threading
from pathlib import Path

import msgspec

from ego_agent.plan.intents.combine import Standing, has_ended, is_in_force, name_of, standing
from swarm.errors import DecisionError
from swarm.files import write_whole
from swarm.log import Logger
from swarm.messages import EgoSteering, IntentInForce
from swarm.messages.obeyed import MAX_INTENTS


class StoredIntents(msgspec.Struct, frozen=True, kw_only=True):
    """The file of an ego's intents."""

    last: int = 0
    """The highest number that was given."""
    intents: tuple[IntentInForce, ...] = ()


class Intents:
    """Confirmed intents, in force or waiting for their start. Any thread may call."""

    def __init__(self, ego: str, path: Path | None, log: Logger) -> None:
        """`path`: where they are kept; None: not at all. A file that cannot be read is said and
        left alone until the next intent is confirmed."""
        self._ego = ego
        self._path = path
        self._log = log
        self._lock = threading.Lock()
        self._kept = _read(path, log)
        self._standing = Standing()

    def all(self) -> tuple[IntentInForce, ...]:
        """Those that have not ended, oldest first."""
        return self._kept.intents

    def standing(self, now_ns: int) -> Standing:
        """What is wished now, of all that are in force. What has ended is forgotten."""
        over = [one for one in self._kept.intents if has_ended(one, now_ns)]
        for one in over:
            self._forget(one)
            self._log.info("intent_ended", intent=name_of(one), until=one.intent.until)
        active = tuple(one for one in self._kept.intents if is_in_force(one, now_ns))
        if active != self._standing.intents:
            self._standing = standing(active)
        return self._standing

    def made(self, request: EgoSteering, now_ns: int) -> IntentInForce:
        """The intent of a request as it would be in force, under its number or the next one.

        Raises DecisionError where it wishes nothing, is over, contradicts itself, names a place of
        which no polygon came, or is one too many.
        """
        intent = request.intent
        if intent is None or intent.is_empty():
            raise DecisionError("the intent wishes nothing")
        both = set(intent.exclude) & {*(intent.only or ()), *intent.prefer}
        if both:
            raise DecisionError(f"robot {min(both)!r} is both to be left out and to be asked")
        if self._ego in intent.exclude:
            raise DecisionError(f"robot {self._ego!r} is the ego's own: it always takes part")
        drawn = {place.name for place in request.places}
        for spot in intent.focus:
            if spot.place not in drawn:
                listed = ", ".join(sorted(drawn)) or "none"
                raise DecisionError(f"place {spot.place!r} has no polygon; drawn: {listed}")
        kept = self._kept
        number = request.number or kept.last + 1
        if sum(one.number != number for one in kept.intents) >= MAX_INTENTS:
            raise DecisionError(
                f"{MAX_INTENTS} intents are in force or waiting: withdraw one first"
            )
        named = {spot.place for spot in intent.focus}
        one = IntentInForce(
            number=number,
            intent=intent,
            operator=request.operator,
            since_ns=now_ns,
            wish=request.said,
            places=tuple(place for place in request.places if place.name in named),
        )
        if has_ended(one, now_ns):
            raise DecisionError(f"until {intent.until} is over")
        return one

    def confirm(self, one: IntentInForce) -> None:
        """Obeys an intent from now on. Raises DecisionError where it cannot be kept."""
        with self._lock:
            others = [kept for kept in self._kept.intents if kept.number != one.number]
            self._write(
                StoredIntents(last=max(self._kept.last, one.number), intents=(*others, one))
            )
        self._log.info(
            "intent_confirmed", intent=name_of(one), wish=msgspec.to_builtins(one.intent)
        )

    def withdraw(self, number: int, operator: str) -> None:
        """Ends an intent. Raises DecisionError where there is none with that number."""
        found = [one for one in self._kept.intents if one.number == number]
        if not found:
            numbers = ", ".join(str(one.number) for one in self._kept.intents) or "none"
            raise DecisionError(f"no wish {number} is in force or waiting; there are: {numbers}")
        self._forget(found[0])
        self._log.info("intent_withdrawn", intent=name_of(found[0]), operator=operator)

    def _forget(self, one: IntentInForce) -> None:
        with self._lock:
            rest = tuple(kept for kept in self._kept.intents if kept.number != one.number)
            kept = msgspec.structs.replace(self._kept, intents=rest)
            try:
                self._write(kept)
            except DecisionError as error:
                # It has ended all the same; after a restart its time, if it had one, ends it again.
                self._kept = kept
                self._log.error("intents_not_kept", error=str(error))

    def _write(self, kept: StoredIntents) -> None:
        if self._path is not None:
            try:
                write_whole(self._path, msgspec.json.format(msgspec.json.encode(kept), indent=1))
            except OSError as error:
                raise DecisionError(f"intents cannot be kept: {error}") from error
        self._kept = kept


def _read(path: Path | None, log: Logger) -> StoredIntents:
    if path is None:
        return StoredIntents()
    try:
        return msgspec.json.decode(path.read_bytes(), type=StoredIntents)
    except FileNotFoundError:
        return StoredIntents()
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        log.error("intents_not_read", path=str(path), error=str(error))
        return StoredIntents()
