"""The journal: what the ego saw, decided and received, one JSON line a completed cycle.

A line is on the disk (fsync) before its cycle counts as completed, so `kill -9` loses no completed
cycle. A line that a crash tore is moved to `<path>.torn` at the next start. A full file becomes a
part (swarm/line_file.py), and `<path>.sums` says what was received in all parts before. The format
is described in docs/journal.md.
"""

from __future__ import annotations

import errno
import os
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from ego_agent.knowledge.weighed import Weighed
from swarm.errors import JournalError
from swarm.files import write_whole
from swarm.line_file import PART_BYTES, PARTS, LineFile, open_parts
from swarm.messages import AdviceReport, Algorithm, Assignment, IntentTold, Probe, Source

VERSION = 1
MAX_PENDING = 600
"""Lines kept in memory while the disk refuses them; the oldest go first."""


class RobotInput(msgspec.Struct, frozen=True, kw_only=True):
    """What the ego knew of one robot; a value that it did not know is null."""

    alive: bool
    distance_m: float | None
    beacon_age_s: float | None
    scene_age_s: float | None
    round_trip_s: float | None
    clock_offset_s: float
    sizes: Mapping[str, int]
    """Bytes of one observation by algorithm."""
    capacity_bps: float | None = None
    """Of its own link, where that is known to be less than C(t)."""
    in_time: Mapping[str, float] = {}
    """Probability that its answers meet the deadline in force, by algorithm that was tried."""
    answer_ms: Mapping[str, float] = {}
    """Median time from question to answer, by algorithm."""


class Inputs(msgspec.Struct, frozen=True, kw_only=True):
    """What the decision was made from."""

    robots: Mapping[str, RobotInput]
    excluded: Mapping[str, str]
    """Robots that could not take part, and why."""
    capacity_bps: float
    capacity_source: str
    capacity_error: float | None = None
    """Share by which what was measured is off what a fresh `net/state` says."""


class Decided(msgspec.Struct, frozen=True, kw_only=True):
    """The decision, without what the line says elsewhere."""

    participants: tuple[str, ...]
    algorithm: Algorithm
    reason: str
    source: Source
    policy: str
    valid: bool
    repairs: tuple[str, ...]
    quality: float
    cost_bytes: int
    model: str = ""
    """The language model whose advice it follows."""
    rate_hz: float | None = None
    deadline_s: float | None = None
    arrival: Mapping[str, float] = {}
    """Probability that each participant's observation is in time."""
    probe: Probe | None = None
    """What was asked on the side."""
    held_s: float | None = None
    """For how long the same had been decided."""
    blind: str = ""
    """Why the ego gets nobody's help, or is not to be relied on at all; empty while it does."""
    silent: Mapping[str, str] = {}
    """Chosen robots of which nothing arrives, and why."""
    stands_in_for: str | None = None
    """The ego in whose stead this one decided; None: in its own."""
    assignments: tuple[Assignment, ...] = ()
    """What each participant sends, and how often, where that is not the same of all."""


class Frames(msgspec.Struct, frozen=True, kw_only=True):
    """Counts of frames (fused, skipped, failed) and of answers that came too late."""

    fused: int
    skipped: int
    failed: int
    late_answers: int
    boxes: int
    """Boxes of the cycle's last fused frame."""
    caught_up: int = 0
    """Of the late answers, those that memory has taken up."""


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """Milliseconds; the frame figures are null when no frame was fused."""

    cycle_ms: float
    """From the snapshot to the published decision."""
    frame_p50_ms: float | None
    frame_max_ms: float | None


class Demand(msgspec.Struct, frozen=True, kw_only=True):
    """What the ego said it needs of its cell to reach Q_min; see `messages.NetDemand`."""

    needed_bytes_s: int
    possible: bool
    reachable: bool
    unreachable_s: float
    mean_bytes_s: int = 0
    burst_bytes: int = 0


class CycleRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One completed control cycle: one line of the journal."""

    v: int = VERSION
    ego: str
    cycle: int
    started_ns: int
    inputs: Inputs
    decision: Decided
    published: bool
    """The decision reached the router's link."""
    bytes: Mapping[str, Mapping[str, int]]
    """Payload bytes received in this cycle, by robot and algorithm."""
    frames: Frames
    missing: Mapping[str, Mapping[str, int]]
    """Frames without a chosen robot's contribution, by robot and reason."""
    latency: Latency
    outcome: str
    """`complete`, `partial` (someone was missing), `alone` or `no frames`."""
    demand: Demand | None = None
    """None in lines of older programs, and where the scene could not be told."""
    advice: AdviceReport | None = None
    """None in lines of older programs, and of policies that ask no language model."""
    intents: tuple[IntentTold, ...] = ()
    """Operators' intents that the decision obeys, and what each did to it."""
    weighed: Weighed | None = None
    """None in lines of older programs, and where the scene could not be told."""


ByteTotals = Counter[tuple[str, str]]
"""Bytes by (robot, algorithm)."""


def byte_totals(record: CycleRecord) -> ByteTotals:
    """The bytes of one line by (robot, algorithm)."""
    return Counter(
        {(robot, name): n for robot, by_name in record.bytes.items() for name, n in by_name.items()}
    )


class _Sums(msgspec.Struct, frozen=True, kw_only=True):
    """What the lines say that are in full parts."""

    last_cycle: int
    """The last of them."""
    bytes: Mapping[str, Mapping[str, int]]
    """By robot and algorithm."""


class Journal:
    """The writing end of a journal file, locked against a second writer."""

    def __init__(self, path: Path, *, part_bytes: int = PART_BYTES, parts: int = PARTS) -> None:
        """Opens or makes the file and cuts a torn last line off into `<path>.torn`.

        Raises JournalError when the file cannot be written, another process writes it, or a line
        before the last cannot be read.
        """
        self.path = path
        self.totals: ByteTotals = Counter()
        """Bytes of all committed lines, by (robot, algorithm); those of parts that went, too."""
        self.last_cycle: int | None = None
        self.torn_bytes = 0
        """Size of the torn line that was cut off at this start."""
        self.dropped = 0
        """Lines that were given up because the disk refused too many."""
        self._pending: deque[CycleRecord] = deque()
        try:
            self._file = LineFile(path, part_bytes=part_bytes, parts=parts)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES) and path.is_file():
                raise JournalError(
                    f"journal {str(path)!r} is being written by another ego; "
                    "give each ego a file of its own with COADAPT_JOURNAL"
                ) from error
            raise JournalError(f"journal {str(path)!r} cannot be opened: {error}") from error
        try:
            self._file.keep(self._recover())
        except OSError as error:
            self._file.close()
            raise JournalError(f"journal {str(path)!r} cannot be written: {error}") from error
        except JournalError:
            self._file.close()
            raise

    @property
    def next_cycle(self) -> int:
        """The number that the next cycle takes: journals go on across restarts."""
        return 1 if self.last_cycle is None else self.last_cycle + 1

    @property
    def pending(self) -> int:
        """Lines that wait for a disk that refused them."""
        return len(self._pending)

    def commit(self, record: CycleRecord) -> list[CycleRecord]:
        """Appends a line and returns all lines that are now on the disk and were not before.

        While the disk refuses, lines wait in memory, at most MAX_PENDING of them. Raises
        JournalError when nothing could be written; the record is then kept for the next call.
        """
        self._pending.append(record)
        if len(self._pending) > MAX_PENDING:
            self._pending.popleft()
            self.dropped += 1
        lines = b"".join(msgspec.json.encode(waiting) + b"\n" for waiting in self._pending)
        try:
            if self._file.is_full:
                # The lines matter more than the size of the file.
                with suppress(OSError):
                    self._begin_part()
            self._file.append(lines)
        except OSError as error:
            raise JournalError(
                f"journal {str(self.path)!r} refused a line: {error}; "
                f"{len(self._pending)} lines wait in memory"
            ) from error
        written = list(self._pending)
        self._pending.clear()
        for done in written:
            self._note(done)
        return written

    def close(self) -> None:
        """Closes the file and lets go of the lock."""
        self._file.close()

    def _begin_part(self) -> None:
        """The sums come first: the lines that they hold are known by their cycles, so that a crash
        in between counts none twice."""
        assert self.last_cycle is not None
        by_robot: dict[str, dict[str, int]] = {}
        for (robot, algorithm), size in self.totals.items():
            by_robot.setdefault(robot, {})[algorithm] = size
        sums = _Sums(last_cycle=self.last_cycle, bytes=by_robot)
        write_whole(_sums_path(self.path), msgspec.json.encode(sums))
        self._file.rotate()

    def _recover(self) -> int:
        """Reads the sums and all lines after them; returns the file's size without a torn last
        line, which is moved away."""
        sums = _read_sums(self.path)
        if sums is not None:
            self.last_cycle = sums.last_cycle
            for robot, by_name in sums.bytes.items():
                self.totals.update({(robot, name): n for name, n in by_name.items()})
        size = 0
        with open(self.path, "rb") as source:
            for number, line in enumerate(source, start=1):
                record = _parse(self.path, number, line)
                if record is None:
                    # Nothing may follow a torn line; a blank tail of a probe counts as torn too.
                    if source.read(1):
                        raise JournalError(
                            f"journal {str(self.path)!r} line {number} cannot be read and is not "
                            "the last; move the file away to start a new one"
                        )
                    self._cut(line)
                    break
                size += len(line)
                if sums is None or record.cycle > sums.last_cycle:
                    self._note(record)
        return size

    def _cut(self, torn: bytes) -> None:
        with open(self.path.with_name(self.path.name + ".torn"), "ab") as aside:
            aside.write(torn + b"\n")
            aside.flush()
            os.fsync(aside.fileno())
        self.torn_bytes = len(torn)

    def _note(self, record: CycleRecord) -> None:
        self.totals.update(byte_totals(record))
        self.last_cycle = record.cycle


def _sums_path(path: Path) -> Path:
    return path.with_name(path.name + ".sums")


def _read_sums(path: Path) -> _Sums | None:
    """None where no part is full yet. Raises JournalError, and OSError."""
    try:
        return msgspec.json.decode(_sums_path(path).read_bytes(), type=_Sums)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise JournalError(
            f"{str(_sums_path(path))!r} cannot be read: {error}; move it and the journal away to "
            "start a new one"
        ) from error


def read_journal(path: Path) -> Iterator[CycleRecord]:
    """The lines of a journal and of its parts, also of one that is being written (a torn last line
    is left out).

    Raises JournalError when a file or a line before the last cannot be read.
    """
    try:
        parts = open_parts(path)
    except OSError as error:
        raise JournalError(f"journal {str(path)!r} cannot be read: {error}") from error
    with ExitStack() as stack:
        for _, source in parts:
            stack.enter_context(source)
        for part, source in parts:
            yield from _read_part(part, source)


def _read_part(path: Path, source: BinaryIO) -> Iterator[CycleRecord]:
    for number, line in enumerate(source, start=1):
        record = _parse(path, number, line)
        if record is None:
            # What follows half a line was written meanwhile.
            if line.endswith(b"\n") and source.read(1):
                raise JournalError(f"journal {str(path)!r} line {number} cannot be read")
            return
        yield record


_DECODER = msgspec.json.Decoder(CycleRecord)


def _parse(path: Path, number: int, line: bytes) -> CycleRecord | None:
    """The record in a line, or None when the line is torn."""
    if not line.endswith(b"\n"):
        return None
    try:
        record = _DECODER.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None
    if record.v != VERSION:
        raise JournalError(
            f"journal {str(path)!r} line {number} has version {record.v}; "
            f"this program reads version {VERSION}"
        )
    return record
