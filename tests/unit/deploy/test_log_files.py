"""A full log becomes a part, while a process goes on to write it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from deploy.netns import control
from deploy.netns.log_files import rotate_logs
from deploy.runtimes.netns import _lines
from deploy.spec import make_spec


def test_a_full_log_becomes_a_part_and_its_writer_goes_on(tmp_path: Path) -> None:
    log = tmp_path / "ego-R1.log"
    writer = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in range(5):
        os.write(writer, b"%d" % number * 100)
        rotate_logs(tmp_path, log_bytes=100, parts=3)
    os.write(writer, b"now")
    os.close(writer)
    held = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert held == {
        "ego-R1.log": b"now",
        "ego-R1.log.1": b"4" * 100,
        "ego-R1.log.2": b"3" * 100,
        "ego-R1.log.3": b"2" * 100,
    }


def test_a_log_that_is_not_full_is_let_be(tmp_path: Path) -> None:
    (tmp_path / "router.log").write_bytes(b"x" * 99)
    rotate_logs(tmp_path, log_bytes=100)
    assert [path.name for path in tmp_path.iterdir()] == ["router.log"]


def test_a_log_that_cannot_be_copied_does_not_grow_either(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.log").write_bytes(b"x" * 100)

    def refuse(*_: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr("shutil.copyfile", refuse)
    rotate_logs(tmp_path, log_bytes=100)
    assert {path.name: path.stat().st_size for path in tmp_path.iterdir()} == {"a.log": 0}


def test_who_follows_a_log_goes_on_when_it_has_been_emptied(tmp_path: Path) -> None:
    log = tmp_path / "router.log"
    log.write_text("the first line\n")
    (tmp_path / control.SOCKET).touch()
    spec = make_spec(robots=("R1", "R2"), run_dir=str(tmp_path))
    lines = _lines(log, spec, True)
    assert next(lines) == "the first line"
    rotate_logs(tmp_path, log_bytes=1)
    with open(log, "a") as writer:
        writer.write("then\n")
    assert next(lines) == "then"
