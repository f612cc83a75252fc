from __future__ import annotations

import pytest

from sensing.opening import open_world_of
from swarm.errors import SettingError
from swarm.process import ProcessSettings


def test_an_unknown_world_is_refused_with_what_is_allowed() -> None:
    with (
        pytest.raises(SettingError, match=r"COADAPT_WORLD = 'mars'; allowed: bag, factory, opv2v"),
        open_world_of(ProcessSettings(world="mars"), "robot_agent", "R1"),
    ):
        pass


@pytest.mark.parametrize(("world", "needs"), [("bag", "bags"), ("ros2", "ros2://HOST")])
def test_a_world_without_its_data_says_what_it_needs(world: str, needs: str) -> None:
    with (
        pytest.raises(SettingError, match=rf"{world}.*COADAPT_WORLD_DATA.*{needs}"),
        open_world_of(ProcessSettings(world=world), "robot_agent", "R1"),
    ):
        pass


def test_a_world_is_open_while_it_is_needed() -> None:
    settings = ProcessSettings(world="factory", world_robots=2)
    with open_world_of(settings, "robot_agent", "R2") as world:
        assert world.robots == ("R1", "R2")
