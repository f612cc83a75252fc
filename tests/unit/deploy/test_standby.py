"""A specification with a standby ego, and the processes that come of it."""

from __future__ import annotations

import pytest
import yaml

from deploy.docker import compose
from deploy.netns.supervisor import place_of
from deploy.services import services
from deploy.spec import SwarmSpec, make_spec
from swarm.errors import DeployError

ROBOTS = ("R1", "R2", "R3")


def spec(**values: object) -> SwarmSpec:
    return make_spec(swarm="s", robots=ROBOTS, **values)


def test_the_two_egos_and_the_controller_know_of_each_other() -> None:
    wanted = spec(ego="R3", ego_standby="R2")
    found = {s.name: s for s in services(wanted, place_of(wanted))}
    assert [name for name in found if name.startswith("ego-")] == ["ego-R3", "ego-R2"]
    first, standby = found["ego-R3"], found["ego-R2"]
    assert (first.host, standby.host) == ("R3", "R2")
    assert first.env["COADAPT_EGO_STANDBY"] == "R2"
    assert "COADAPT_STANDS_IN_FOR" not in first.env
    assert standby.env["COADAPT_STANDS_IN_FOR"] == "R3"
    assert "COADAPT_EGO_STANDBY" not in standby.env
    assert first.env["COADAPT_JOURNAL"] != standby.env["COADAPT_JOURNAL"]
    assert found["controller"].env["COADAPT_EGO_STANDBY"] == "R2"


def test_without_one_nobody_knows_of_any() -> None:
    for service in services(spec(), place_of(spec())):
        assert not {"COADAPT_EGO_STANDBY", "COADAPT_STANDS_IN_FOR"} & service.env.keys()


@pytest.mark.parametrize("standby", ["R1", "R9"])
def test_an_ego_does_not_stand_in_for_itself_nor_does_one_that_is_not_there(standby: str) -> None:
    with pytest.raises(DeployError, match=rf"{standby}.*R2, R3"):
        spec(ego_standby=standby)


def test_only_the_first_ego_takes_a_port_of_the_host_in_docker() -> None:
    text = compose.compose_file(spec(runtime="docker", ego_standby="R2"), "image", "", "127.0.0.1")
    containers = yaml.safe_load(text)["services"]
    assert "ports" in containers["ego-R1"]
    assert "ports" not in containers["ego-R2"]
