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
    line: CycleRecord | None = None
    since, first = 0, 0
    before: CycleRecord | None = None
    for record in records:
        if line is None or choice(record) != choice(line):
            before, since = line, record.cycle
        first = first or record.cycle
        line = record
        if record.cycle == cycle:
            break
    if line is None:
        raise JournalError("the journal holds no line yet")
    if cycle is not None and line.cycle != cycle:
        raise JournalError(f"the journal holds no cycle {cycle}; allowed: {first} to {line.cycle}")
    return Found(line, since, before)


def choice(record: CycleRecord) -> tuple[frozenset[str], str, float | None]:
    """What a change of a decision changes; the ego alone fuses nothing, however it would."""
    decision = record.decision
    if set(decision.participants) <= {record.ego}:
        return frozenset(), "", None
    return frozenset(decision.participants), decision.algorithm, decision.rate_hz
