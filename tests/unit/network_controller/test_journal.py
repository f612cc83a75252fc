"""The controller's journal: nothing is lost silently, and it does not grow without end."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from network_controller.journal import Journal
from swarm.errors import JournalError
from swarm.line_file import parts_of


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Writing beyond this size fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def actions(path: Path) -> list[str]:
    """Of all lines, also of those in parts."""
    lines = (line for part in parts_of(path) for line in part.read_text().splitlines() if line)
    return [json.loads(line)["action"] for line in lines]


def test_lines_that_a_full_disk_refuses_are_written_when_it_takes_them_again(
    tmp_path: Path,
) -> None:
    path = tmp_path / "actions.jsonl"
    journal = Journal(path)
    journal.note(1, "first", "why")
    with file_size_limit(path.stat().st_size + 20):
        journal.note(2, "second", "why")
        journal.note(3, "third", "why")
        assert (journal.pending, journal.lost) == (2, 0)
    journal.note(4, "fourth", "why")
    assert (journal.pending, journal.lost) == (0, 0)
    journal.close()
    assert actions(path) == ["first", "second", "third", "fourth"]


def test_lines_that_wait_are_written_without_another_one(tmp_path: Path) -> None:
    path = tmp_path / "actions.jsonl"
    journal = Journal(path)
    journal.note(1, "first", "why")
    with file_size_limit(path.stat().st_size + 20):
        journal.note(2, "second", "why")
        journal.retry()
        assert journal.pending == 1
    journal.retry()
    assert (journal.pending, actions(path)) == (0, ["first", "second"])
    with file_size_limit(path.stat().st_size + 20):
        journal.note(3, "third", "why")
    journal.close()
    assert actions(path) == ["first", "second", "third"]


def test_full_files_become_parts_of_which_the_oldest_go(tmp_path: Path) -> None:
    path = tmp_path / "actions.jsonl"
    journal = Journal(path, part_bytes=200, parts=2)
    for number in range(40):
        journal.note(number, f"a{number}", "why")
    journal.close()
    assert [part.name for part in parts_of(path)] == [
        "actions.jsonl.2",
        "actions.jsonl.1",
        "actions.jsonl",
    ]
    found = actions(path)
    assert found == [f"a{number}" for number in range(40 - len(found), 40)]
    assert 5 < len(found) < 20


def test_two_controllers_do_not_write_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "actions.jsonl"
    journal = Journal(path)
    with pytest.raises(JournalError, match="cannot be written"):
        Journal(path)
    journal.close()
