"""A specification with several egos, the processes that come of it, and how commands see it."""

from __future__ import annotations

import argparse
from typing import Any

import pytest

from coadapt.commands import steer
from coadapt.main import main
from deploy.docker import compose
from deploy.netns.supervisor import place_of
from deploy.services import services
from deploy.spec import SwarmSpec, make_spec
from deploy.state import State, seen_by
from network_controller.requests import links_of
from network_controller.settings import ControllerSettings
from options.console.settings import ConsoleSettings
from swarm.errors import DecisionError, DeployError
from swarm.messages import ShapeRequest
from swarm.settings import load

ROBOTS = ("R1", "R2", "R3", "R4")


def spec(**values: Any) -> SwarmSpec:
    return make_spec(swarm="s", robots=ROBOTS, **values)


def test_each_ego_is_a_process_on_its_own_robots_host_with_its_own_journal() -> None:
    wanted = spec(egos=("R4", "R2"))
    assert (wanted.ego, wanted.all_egos) == ("R4", ("R4", "R2"))
    egos = [s for s in services(wanted, place_of(wanted)) if s.role == "ego"]
    assert [(s.name, s.host, s.env["COADAPT_EGO"]) for s in egos] == [
        ("ego-R4", "R4", "R4"),
        ("ego-R2", "R2", "R2"),
    ]
    assert len({s.env["COADAPT_JOURNAL"] for s in egos}) == 2
    told = {s.name: s.env for s in services(wanted, place_of(wanted))}
    assert load(ControllerSettings, told["controller"]).cells == ("R4", "R2")


def test_the_ego_that_is_named_comes_first_and_one_ego_is_none_of_several() -> None:
    assert spec(ego="R2", egos=("R1", "R2", "R3")).egos == ("R2", "R1", "R3")
    alone = spec(egos=("R3",))
    assert (alone.ego, alone.egos, alone.all_egos) == ("R3", (), ("R3",))
    assert alone.same_as(spec(ego="R3"))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"egos": ("R1", "R9")}, r"egos = \('R1', 'R9'\) .* different ones of the robots R1, R2"),
        ({"egos": ("R1", "R1")}, "different ones of the robots"),
        ({"ego": "R3", "egos": ("R1", "R2")}, "with the ego R3"),
        ({"egos": ("R1", "R2"), "ego_standby": "R2"}, "a robot that is not the ego: R3, R4"),
    ],
)
def test_who_cannot_decide_is_named(values: dict[str, Any], words: str) -> None:
    with pytest.raises(DeployError, match=words):
        spec(**values)


def test_a_standby_stands_in_for_the_first_ego_only() -> None:
    wanted = spec(egos=("R1", "R2"), ego_standby="R3")
    found = {s.name: s.env for s in services(wanted, place_of(wanted))}
    assert found["ego-R1"]["COADAPT_EGO_STANDBY"] == "R3"
    assert "COADAPT_EGO_STANDBY" not in found["ego-R2"]
    assert found["ego-R3"]["COADAPT_STANDS_IN_FOR"] == "R1"
    assert load(ControllerSettings, found["controller"]).cells == ("R1", "R2", "R3")


def test_the_console_knows_all_egos_and_docker_publishes_the_first_ones_metrics() -> None:
    wanted = spec(egos=("R2", "R1"), console=True, runtime="docker")
    members = services(wanted, compose.PLACE)
    (console,) = [s for s in members if s.role == "console"]
    settings = load(ConsoleSettings, console.env)
    assert (settings.ego, settings.egos) == ("R2", ("R2", "R1"))
    published = {s.name for s in members if s.role == "ego" and compose._published(wanted, s)}
    assert published == {"ego-R2"}


def test_a_request_without_a_robot_means_the_cells_of_all_egos_that_are_here() -> None:
    here = frozenset({"R1", "R2", "R4"})
    links = links_of(ShapeRequest(profile="off"), "R1", here, ("R2", "R3"))
    assert [link.robot for link in links] == ["R1", "R2"]
    named = links_of(ShapeRequest(profile="off", robot="R4"), "R1", here, ("R2",))
    assert [link.robot for link in named] == ["R4"]


def test_commands_are_about_the_ego_that_is_named() -> None:
    state = State(runtime="netns", spec=spec(egos=("R1", "R2"), ego_standby="R3"), router="tcp/a:1")
    assert seen_by(state, None) is state
    other = seen_by(state, "R2")
    assert (other.spec.ego, other.spec.ego_standby) == ("R2", None)
    with pytest.raises(DeployError, match=r"robot 'R4' does not decide .* egos are R1, R2"):
        seen_by(state, "R4")


def test_no_ego_is_blinded_by_accident() -> None:
    wanted = spec(egos=("R1", "R2"))
    asked = argparse.Namespace(stop=["R2"], start=[], yes=False, policy=None, q_min=None)
    with pytest.raises(DecisionError, match="robot 'R2' is the ego's own"):
        steer._wishes(asked, wanted)


@pytest.mark.parametrize(
    ("egos", "words"),
    [("R1,R9", "--egos ('R1', 'R9') is not valid; it must be different ones of the robots R1, R2")],
)
def test_up_names_the_option(egos: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--runtime", "netns", "--swarm", "qa-egos", "--robots", "3", "--egos", egos)
    assert main(["up", *arguments]) == 1
    assert words in capsys.readouterr().err.splitlines()[-1]
