"""`coadapt wish` on a real swarm: an intent is read back, confirmed, obeyed, shown and ended."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from coadapt.commands.status import render
from coadapt.main import main
from deploy.observe import Watch
from deploy.state import need_state
from ego_agent.knowledge.journal import read_journal
from tests.support.ego_swarm import Swarm, stop, until
from tests.support.recorded_swarm import (  # noqa: F401
    EGO,
    OTHER,
    recorded_swarm,
    start_ego,
    together,
)

JOURNAL = "journal.jsonl"


def run(*arguments: str) -> int:
    return main([arguments[0], "--swarm", "test", *arguments[1:]])


def test_a_wish_is_read_back_confirmed_obeyed_shown_and_withdrawn(
    swarm: Swarm, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    start_ego(swarm, tmp_path / JOURNAL)
    decisions.until(together)
    assert run("wish", "--list") == 0
    assert capsys.readouterr().out == "R1 obeys no wish\n"

    leave = ("wish", "--intent", '{"exclude": ["R2"]}')
    assert run(*leave) == 0
    shown = capsys.readouterr().out
    assert "understood  leave R2 out\n" in shown
    assert "it leaves NOBODY TO ASK" in shown
    assert shown.endswith("nothing is changed; --apply confirms it\n")
    assert run(*leave, "--apply") == 1
    assert "leaves nobody to ask: confirm that, too, with --sure" in capsys.readouterr().err
    assert run("wish", "--list", "--json") == 0
    assert json.loads(capsys.readouterr().out) == []

    assert run(*leave, "--apply", "--sure") == 0
    assert "R1 obeys wish 1 of " in capsys.readouterr().out
    obeying = decisions.until(lambda d: bool(d.intents))
    assert not together(obeying)
    assert obeying.intents[0].bound == ("R2 left out",)
    assert obeying.excluded[OTHER].startswith("left out by wish 1 of ")
    assert obeying.valid
    assert not obeying.blind
    with Watch(need_state("test")) as watch:
        until(watch.decided, "a decision")
        assert ": leave R2 out (R2 left out)" in render(watch.view(), ())

    assert run("wish", "--withdraw", "1") == 0
    assert capsys.readouterr().out == "wish 1 has ended\n"
    decisions.until(lambda d: together(d) and not d.intents)
    assert run("wish", "--withdraw", "1") == 1
    assert "no wish 1 is in force or waiting; there are: none" in capsys.readouterr().err
    lines = [record.intents for record in read_journal(tmp_path / JOURNAL)]
    assert any(told and told[0].says == "leave R2 out" for told in lines)


def test_a_wish_by_its_fields_outlives_the_ego_and_ends_by_itself(
    swarm: Swarm, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    ego = start_ego(swarm, tmp_path / JOURNAL)
    decisions.until(together)
    later = (datetime.now(UTC) + timedelta(hours=1)).isoformat()
    wish = ("steer", "--focus", "aisle 1=high", "--link-share", "0.5", "--policy", "static-late")
    assert run(*wish, "--until", later) == 0
    assert "aisle 1 counts more; use at most 50 % of the link" in capsys.readouterr().out
    decisions.until(lambda d: bool(d.intents) and d.policy == "static-late")

    assert stop(ego) == 0
    decisions.skip()
    start_ego(swarm, tmp_path / JOURNAL)
    again = decisions.until(lambda d: bool(d.intents) and d.cycle > 1 and together(d))
    assert again.policy == "static-late"

    assert run("wish", "--withdraw", "1") == 0
    decisions.until(lambda d: not d.intents and d.policy == "coverage")
    soon = (datetime.now(UTC) + timedelta(seconds=8)).isoformat()
    assert run("steer", "--q-min", "0.3", "--save", "compute", "--until", soon) == 0
    decisions.until(lambda d: bool(d.intents) and d.intents[0].number == 2)
    decisions.until(lambda d: not d.intents)
    assert run("wish", "--list") == 0
    assert capsys.readouterr().out.endswith("R1 obeys no wish\n")


def test_what_cannot_be_obeyed_is_named_and_nothing_is_changed(
    swarm: Swarm, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    decisions = swarm.decisions(swarm.session(), EGO)
    start_ego(swarm, tmp_path / JOURNAL)
    decisions.until(together)
    past = "2020-01-01T00:00:00+00:00"
    for intent, expected in (
        ({"exclude": ["R9"]}, "there is no robot 'R9'; known: R1, R2"),
        ({"focus": [{"place": "moon"}]}, "there is no place 'moon'; known: aisle 1"),
        ({"classes": {"cat": "high"}}, "there is no class 'cat'; known: person, forklift"),
        ({"exclude": ["R1"]}, "robot 'R1' is the ego's own"),
        ({"exclude": ["R2"], "prefer": ["R2"]}, "robot 'R2' is both"),
        ({"q_min": 0.8, "until": past}, "is over"),
        ({"policy": "dice"}, "policy 'dice' is unknown"),
        ({"unclear": ["hello?"]}, "no wish was understood in 'hello?'"),
        ({"until": "2040-01-01T00:00:00+00:00"}, "the intent wishes nothing"),
        ({"leave": ["R2"]}, "an intent has no field 'leave'"),
    ):
        assert run("wish", "--intent", json.dumps(intent), "--apply", "--sure") == 1
        assert expected in capsys.readouterr().err
    assert run("wish", "leave R2 alone") == 1
    assert "no language model answers in swarm 'test'" in (told := capsys.readouterr().err)
    assert "`coadapt steer` takes the same as flags: --exclude" in told
    assert told.count("\n") == 1
    assert run("wish", "--intent", "no such file") == 1
    assert "neither a JSON object nor a file" in capsys.readouterr().err
    assert run("wish", "--list") == 0
    assert capsys.readouterr().out == "R1 obeys no wish\n"
