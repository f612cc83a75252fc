"""A decision's line in a journal, and that of the decision before it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ego_agent.knowledge.journal import CycleRecord
from swarm.errors import JournalError


@dataclass(frozen=True, slots=True)
class Found:
    """What an explanation is made from."""

    line: CycleRecord
    since: int
    """The first cycle of the same choice, as far as the journal goes back."""
    before: CycleRecord | None
    """The last line of the choice before; None where the journal holds none."""


def find(records: Iterable[CycleRecord], cycle: int | None = None) -> Found:
    """The line of that cycle, the newest where None, in lines as they were written.

    Raises JournalError where there is no such line.
    """
    follower, first = Follower(), 0
    for record in records:
        follower.add(record)
        first = first or record.cycle
        if record.cycle == cycle:
            break
    found = follower.found
    if found is None:
        raise JournalError("the journal holds no line yet")
    if cycle is not None and found.line.cycle != cycle:
        last = found.line.cycle
        raise JournalError(f"the journal holds no cycle {cycle}; allowed: {first} to {last}")
    return found


class Follower:
    """Follows a journal's lines, and knows what an explanation of the newest is made from."""

    def __init__(self) -> None:
        self.found: Found | None = None
        """None before the first line."""

    def add(self, record: CycleRecord) -> None:
        """The next line."""
        last = self.found
        if last is None:
            self.found = Found(record, record.cycle, None)
        elif choice(record) == choice(last.line):
            self.found = Found(record, last.since, last.before)
        else:
            self.found = Found(record, record.cycle, last.line)


def choice(record: CycleRecord) -> tuple[frozenset[str], str, float | None]:
    """What a change of a decision changes; the ego alone fuses nothing, however it would."""
    decision = record.decision
    if set(decision.participants) <= {record.ego}:
        return frozenset(), "", None
    return frozenset(decision.participants), decision.algorithm, decision.rate_hz
