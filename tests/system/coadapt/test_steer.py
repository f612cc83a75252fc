"""`coadapt steer` on a real swarm: another policy, another Q_min, robots off duty and back."""

from __future__ import annotations

import json

import pytest

from coadapt.main import main
from swarm import keyspace
from swarm.errors import RefusedError
from swarm.messages import Observation, ObservationRequest
from tests.support.ego_swarm import Swarm, metrics_of
from tests.support.recorded_swarm import (  # noqa: F401
    EGO,
    OTHER,
    OTHER_METRICS,
    recorded_swarm,
    start_ego,
    together,
)

WAIT_S = 20.0


@pytest.fixture(autouse=True)
def an_ego(swarm: Swarm) -> None:
    start_ego(swarm)


def steer(*arguments: str) -> int:
    return main(["steer", "--swarm", "test", *arguments])


def test_an_operator_steers_a_running_swarm(
    swarm: Swarm, capsys: pytest.CaptureFixture[str]
) -> None:
    session = swarm.session()
    decisions = swarm.decisions(session, EGO)
    decisions.until(together)

    assert steer() == 0
    assert capsys.readouterr().out == "R1 decides by coverage, Q_min 0.6\n"
    assert steer("--policy", "static-late", "--q-min", "0.5") == 0
    assert capsys.readouterr().out == "R1 decides by static-late, Q_min 0.5\n"
    late = decisions.until(lambda d: d.policy == "static-late" and together(d))
    assert late.algorithm == "late"
    assert late.valid
    # A policy that asks others, and back: the swarm has no gateway.
    assert steer("--policy", "llm") == 0
    decisions.until(lambda d: d.policy == "llm" and d.source == "fallback")
    assert steer("--policy", "coverage") == 0
    decisions.until(lambda d: d.policy == "coverage")
    capsys.readouterr()

    assert steer("--stop", OTHER) == 0
    assert "R2 is off duty, by " in capsys.readouterr().out
    decisions.until(lambda d: not together(d))
    assert session.alive() == ()
    assert metrics_of(OTHER_METRICS)['coadapt_robot_on_duty{robot="R2"}'] == 0
    request = ObservationRequest(ego=EGO, request=1, algorithm="early", capture_ns=0)
    asked = session.ask(keyspace.observation("test", OTHER), request, Observation, timeout_s=WAIT_S)
    with pytest.raises(RefusedError, match="robot R2 is off duty"):
        asked.result(WAIT_S)
    assert steer("--start", OTHER, "--json") == 0
    ego, robot = json.loads(capsys.readouterr().out)
    assert (ego["policy"], robot["robot"], robot["on_duty"]) == ("coverage", OTHER, True)
    decisions.until(together)
    assert session.alive() == (OTHER,)
    assert metrics_of(OTHER_METRICS)['coadapt_robot_on_duty{robot="R2"}'] == 1


def test_what_cannot_be_done_is_named_and_nothing_is_changed(
    swarm: Swarm, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = swarm.session()
    decisions = swarm.decisions(session, EGO)
    decisions.until(together)
    monkeypatch.setattr("coadapt.asking.FIND_S", 0.5)
    for arguments, expected in (
        (["--policy", "best", "--q-min", "0.2"], "policy 'best' is unknown; allowed: coverage"),
        (["--q-min", "1.5"], "the wish is not valid: Expected `float` <= 1.0"),
        (["--q-min", "0.2", "--stop", "R9"], "robot R9 of swarm 'test' does not answer"),
        (["--stop", OTHER, "--start", OTHER], "robot 'R2' is both to stop and to start"),
        (["--stop", EGO], "robot 'R1' is the ego's own: without it the ego is blind"),
        (["--stop", "R 2"], "robot id 'R 2' is not allowed"),
    ):
        assert steer(*arguments) == 1
        assert expected in capsys.readouterr().err
    assert steer() == 0
    assert capsys.readouterr().out == "R1 decides by coverage, Q_min 0.6\n"
    assert session.alive() == (OTHER,)


def test_an_ego_whose_own_robot_is_taken_off_duty_is_blind_until_it_is_back(
    swarm: Swarm, capsys: pytest.CaptureFixture[str]
) -> None:
    swarm.robot(EGO)
    session = swarm.session()
    decisions = swarm.decisions(session, EGO)
    decisions.until(lambda d: together(d) and set(session.alive()) == {EGO, OTHER})
    assert steer("--stop", EGO, "--yes") == 0
    # A beacon that a busy machine delays makes an ego blind too, for another reason.
    blind = decisions.until(lambda d: "its own robot was taken off duty by " in d.blind)
    assert not blind.valid
    assert blind.quality == 0.0
    assert blind.participants == (EGO,)
    assert steer("--start", EGO) == 0
    assert decisions.until(lambda d: together(d) and not d.blind).valid
