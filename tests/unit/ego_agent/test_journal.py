"""The journal: no completed cycle is lost, nothing is lost silently."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ego_agent.knowledge.journal import (
    CycleRecord,
    Decided,
    Frames,
    Inputs,
    Journal,
    Latency,
    RobotInput,
    _parse,
    byte_totals,
    read_journal,
)
from swarm.errors import JournalError


def test_a_line_of_a_program_that_learnt_nothing_is_read(tmp_path: Path) -> None:
    line = json.loads(msgspec.json.encode(record(1)))
    for name in ("rate_hz", "deadline_s", "arrival", "probe", "held_s", "assignments"):
        del line["decision"][name]
    for name in ("in_time", "answer_ms"):
        del line["inputs"]["robots"]["R2"][name]
    path = tmp_path / "journal"
    path.write_text(json.dumps(line) + "\n")
    (read,) = read_journal(path)
    assert read == record(1)


def record(cycle: int, received: int = 100) -> CycleRecord:
    robot = RobotInput(
        alive=True,
        distance_m=3.2,
        beacon_age_s=0.05,
        scene_age_s=None,
        round_trip_s=0.01,
        clock_offset_s=0.0,
        sizes={"early": 20_000},
    )
    return CycleRecord(
        ego="R1",
        cycle=cycle,
        started_ns=1,
        inputs=Inputs(robots={"R2": robot}, excluded={}, capacity_bps=5e6, capacity_source="prior"),
        decision=Decided(
            participants=("R1", "R2"),
            algorithm="early",
            reason="R2 sees behind the shelf – €",
            source="policy",
            policy="coverage",
            valid=True,
            repairs=(),
            quality=0.9,
            cost_bytes=20_000,
        ),
        published=True,
        bytes={"R2": {"early": received, "late": 1}},
        frames=Frames(fused=10, skipped=0, failed=0, late_answers=0, boxes=4),
        missing={},
        latency=Latency(cycle_ms=1.0, frame_p50_ms=None, frame_max_ms=None),
        outcome="complete",
    )


def write(path: Path, cycles: range) -> None:
    journal = Journal(path)
    for cycle in cycles:
        journal.commit(record(cycle))
    journal.close()


@contextmanager
def file_size_limit(limit: int) -> Iterator[None]:
    """The kernel refuses to write past `limit` bytes of any file, as a full disk would."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_was_committed_is_read_back(tmp_path: Path) -> None:
    write(tmp_path / "j.jsonl", range(1, 4))
    assert list(read_journal(tmp_path / "j.jsonl")) == [record(1), record(2), record(3)]


def test_one_line_holds_one_cycle(tmp_path: Path) -> None:
    write(tmp_path / "j.jsonl", range(1, 4))
    assert (tmp_path / "j.jsonl").read_text().count("\n") == 3


def test_a_journal_goes_on_with_the_next_cycle_and_the_sums_so_far(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "j.jsonl"
    write(path, range(1, 4))
    journal = Journal(path)
    assert journal.next_cycle == 4
    assert journal.totals == {("R2", "early"): 300, ("R2", "late"): 3}
    journal.close()


def test_a_new_journal_begins_with_cycle_one(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j.jsonl")
    assert journal.next_cycle == 1
    journal.close()


@settings(max_examples=40, deadline=None)
@given(cut=st.integers(min_value=1, max_value=5000))
def test_whatever_a_crash_tears_off_is_set_aside_and_the_rest_is_kept(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    path = tmp_path_factory.mktemp("journal") / "j.jsonl"
    write(path, range(1, 5))
    whole = path.read_bytes()
    left = whole[: max(0, len(whole) - cut)]
    path.write_bytes(left)
    complete = left.count(b"\n")

    journal = Journal(path)
    assert journal.next_cycle == complete + 1
    journal.commit(record(complete + 1))
    journal.close()

    assert [r.cycle for r in read_journal(path)] == list(range(1, complete + 2))
    torn = path.with_name("j.jsonl.torn")
    kept = path.read_bytes()[: left.rfind(b"\n") + 1]
    aside = torn.read_bytes()[:-1] if torn.exists() else b""
    assert kept + aside == left


def test_a_reader_leaves_out_the_line_that_is_being_written(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 3))
    with path.open("ab") as file:
        file.write(b'{"v":1,"ego":"R1","cy')
    assert [r.cycle for r in read_journal(path)] == [1, 2]


def test_a_line_that_is_finished_while_it_is_read_is_no_broken_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 4))
    whole = path.read_bytes()
    path.write_bytes(whole[:-30])

    def meanwhile(path: Path, number: int, line: bytes) -> CycleRecord | None:
        if not line.endswith(b"\n"):
            path.write_bytes(whole)
        return _parse(path, number, line)

    monkeypatch.setattr("ego_agent.knowledge.journal._parse", meanwhile)
    assert [r.cycle for r in read_journal(path)] == [1, 2]


def test_a_broken_line_in_the_middle_is_an_error_not_a_loss(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 4))
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + b"{rubbish}\n" + lines[2])
    with pytest.raises(JournalError, match="line 2 cannot be read"):
        Journal(path)
    with pytest.raises(JournalError, match="line 2 cannot be read"):
        list(read_journal(path))
    assert path.read_bytes() == lines[0] + b"{rubbish}\n" + lines[2]


def test_a_journal_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 2))
    path.write_bytes(path.read_bytes().replace(b'{"v":1', b'{"v":9'))
    with pytest.raises(JournalError, match="version 9"):
        Journal(path)


def test_a_second_process_on_the_same_journal_is_refused(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j.jsonl")
    second = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys; from pathlib import Path\n"
            "from ego_agent.knowledge.journal import Journal\n"
            "Journal(Path(sys.argv[1]))",
            str(tmp_path / "j.jsonl"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    journal.close()
    assert second.returncode != 0
    assert "is being written by another ego" in second.stderr


@pytest.mark.parametrize("path", ["", "file/j.jsonl"])
def test_a_path_that_cannot_be_a_journal_is_a_clear_error(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match="cannot be opened"):
        Journal(tmp_path / path)


def test_a_full_disk_is_found_at_the_start(tmp_path: Path) -> None:
    with file_size_limit(100), pytest.raises(JournalError, match="cannot be written"):
        Journal(tmp_path / "j.jsonl")


def test_lines_that_a_full_disk_refuses_are_written_when_it_takes_them_again(
    tmp_path: Path,
) -> None:
    path = tmp_path / "j.jsonl"
    journal = Journal(path)
    assert journal.commit(record(1)) == [record(1)]
    with file_size_limit(path.stat().st_size + 50):
        for cycle in (2, 3):
            with pytest.raises(JournalError, match="lines wait in memory"):
                journal.commit(record(cycle))
        assert [r.cycle for r in read_journal(path)] == [1]
        assert journal.pending == 2
        assert journal.totals == byte_totals(record(1))
    assert journal.commit(record(4)) == [record(2), record(3), record(4)]
    journal.close()
    assert [r.cycle for r in read_journal(path)] == [1, 2, 3, 4]


def test_a_full_file_becomes_a_part_and_the_sums_go_on(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    line = len(msgspec.json.encode(record(1)))
    for first in (1, 31):
        journal = Journal(path, part_bytes=4 * line, parts=3)
        assert journal.next_cycle == first
        for cycle in range(first, first + 30):
            journal.commit(record(cycle))
        assert journal.totals == {("R2", "early"): 100 * (first + 29), ("R2", "late"): first + 29}
        journal.close()
    parts = sorted(file.name for file in tmp_path.iterdir())
    assert parts == ["j.jsonl", "j.jsonl.1", "j.jsonl.2", "j.jsonl.3", "j.jsonl.sums"]
    cycles = [r.cycle for r in read_journal(path)]
    assert cycles == list(range(cycles[0], 61))
    assert len(cycles) > 12
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 24 * line


@pytest.mark.parametrize("happened", ["sums", "moved"])
def test_a_crash_between_two_parts_counts_nothing_twice(tmp_path: Path, happened: str) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 4))
    # What is done on the way: the sums are written, the full file is moved away.
    sums = {"last_cycle": 3, "bytes": {"R2": {"early": 300, "late": 3}}}
    (tmp_path / "j.jsonl.sums").write_text(json.dumps(sums))
    if happened == "moved":
        path.rename(tmp_path / "j.jsonl.1")
    journal = Journal(path)
    assert journal.next_cycle == 4
    assert journal.totals == {("R2", "early"): 300, ("R2", "late"): 3}
    journal.commit(record(4))
    journal.close()
    assert [r.cycle for r in read_journal(path)] == [1, 2, 3, 4]


def test_a_crash_amid_the_change_of_names_reads_every_line_once(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    write(path, range(1, 4))
    (tmp_path / "j.jsonl.1").hardlink_to(path)
    assert [r.cycle for r in read_journal(path)] == [1, 2, 3]


def test_a_reader_misses_no_part_that_is_moved_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    line = len(msgspec.json.encode(record(1)))
    journal = Journal(path, part_bytes=2 * line)
    for cycle in range(1, 10):
        journal.commit(record(cycle))
    reader = read_journal(path)
    cycles = [next(reader).cycle]
    for cycle in range(10, 20):
        journal.commit(record(cycle))
    cycles += [r.cycle for r in reader]
    journal.close()
    assert cycles[:9] == list(range(1, 10))
    assert cycles == list(range(1, len(cycles) + 1))


def test_sums_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "j.jsonl.sums").write_text("{")
    with pytest.raises(JournalError, match=r"j\.jsonl\.sums' cannot be read"):
        Journal(tmp_path / "j.jsonl")


def test_reading_a_journal_that_is_not_there_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match=r"none\.jsonl"):
        list(read_journal(tmp_path / "none.jsonl"))


def test_a_line_of_an_older_program_is_read_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    line = json.loads(msgspec.json.encode(record(1)))
    del line["demand"], line["inputs"]["capacity_error"]
    del line["inputs"]["robots"]["R2"]["capacity_bps"]
    path.write_text(json.dumps(line) + "\n")
    journal = Journal(path)
    journal.commit(record(journal.next_cycle))
    journal.close()
    assert list(read_journal(path)) == [record(1), record(2)]


def test_a_journal_of_an_older_program_reads_as_one_without_advice(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    write(journal, range(1, 2))
    line = json.loads(journal.read_text())
    del line["advice"], line["decision"]["model"]
    journal.write_text(json.dumps(line) + "\n")
    (read,) = read_journal(journal)
    assert read == record(1)
    assert (read.advice, read.decision.model) == (None, "")
