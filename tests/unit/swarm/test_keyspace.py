"""Keys: each has one spelling, and no name can reach into another's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from swarm import keyspace
from swarm.areas import cell_of, name_of
from swarm.errors import KeyspaceError

names = st.from_regex(r"[A-Za-z0-9_-]{1,32}", fullmatch=True)
KEYS: dict[Any, str] = {
    keyspace.alive: "coadapt/S/robot/R/alive",
    keyspace.beacon: "coadapt/S/robot/R/beacon",
    keyspace.scene: "coadapt/S/robot/R/scene",
    keyspace.observation: "coadapt/S/robot/R/observation",
    keyspace.decision: "coadapt/S/ego/R/decision",
    keyspace.detections: "coadapt/S/ego/R/detections",
    keyspace.ego_leads: "coadapt/S/ego/R/leads",
}
every_key = pytest.mark.parametrize("key", KEYS, ids=lambda key: key.__name__)
Key = Callable[[str, str], str]


@every_key
def test_keys_are_spelled_as_the_contract_says(key: Key) -> None:
    assert key("S", "R") == KEYS[key]


def test_the_network_state_has_one_key_a_swarm() -> None:
    assert keyspace.net_state("S") == "coadapt/S/net/state"
    assert keyspace.net_tcp("S") == "coadapt/S/net/tcp"
    assert keyspace.net_demand("S") == "coadapt/S/net/demand"
    assert keyspace.net_shape("S") == "coadapt/S/net/shape"


def test_controllers_of_their_own_hosts_have_keys_of_their_own() -> None:
    assert keyspace.net_state("S", "hall-2") == "coadapt/S/net/state/hall-2"
    assert keyspace.net_shape("S", "hall-2") == "coadapt/S/net/shape/hall-2"
    everybody = zenoh.KeyExpr(keyspace.net_state("S", keyspace.ANY))
    for name in ("", "hall-2"):
        key = keyspace.net_state("S", name)
        assert everybody.includes(zenoh.KeyExpr(key))
        assert keyspace.controller_of(key) == name
    with pytest.raises(KeyspaceError, match="controller name"):
        keyspace.net_shape("S", "hall/2")


@every_key
@given(swarm=names, robot=names)
def test_the_id_in_a_key_can_be_read_back(key: Key, swarm: str, robot: str) -> None:
    assert keyspace.robot_of(key(swarm, robot)) == robot
    zenoh.KeyExpr(key(swarm, robot))


@every_key
def test_any_robot_matches_every_robot_of_its_swarm_only(key: Key) -> None:
    pattern = zenoh.KeyExpr(key("S", keyspace.ANY))
    assert pattern.includes(zenoh.KeyExpr(key("S", "R1")))
    assert not pattern.intersects(zenoh.KeyExpr(key("S2", "R1")))


@every_key
@pytest.mark.parametrize("bad", ["", "a/b", "**", "R*", "a b", "R1\n", "x" * 33, "ü", "$", "a?b#"])
def test_a_name_that_is_no_name_is_refused(key: Key, bad: str) -> None:
    with pytest.raises(KeyspaceError, match="1 to 32"):
        key("S", bad)
    with pytest.raises(KeyspaceError, match="swarm name"):
        key(bad, "R")


@pytest.mark.parametrize("key", [keyspace.beacon, keyspace.scene])
@given(swarm=names, robot=names, x=st.floats(allow_nan=False), y=st.floats(allow_nan=False))
def test_the_id_can_be_read_whatever_the_cell(
    key: Key, swarm: str, robot: str, x: float, y: float
) -> None:
    own = keyspace.within(key(swarm, robot), name_of(cell_of(x, y)))
    assert keyspace.robot_of(own) == robot
    zenoh.KeyExpr(own)


def test_who_listens_anywhere_hears_robots_in_cells_and_in_none() -> None:
    everybody = zenoh.KeyExpr(keyspace.anywhere(keyspace.beacon("S", keyspace.ANY)))
    own = keyspace.beacon("S", "R1")
    assert everybody.includes(zenoh.KeyExpr(own))
    assert everybody.includes(zenoh.KeyExpr(keyspace.within(own, "3_-4")))
    assert not everybody.intersects(zenoh.KeyExpr(keyspace.scene("S", "R1")))


@pytest.mark.parametrize(
    "key",
    [
        "coadapt/S/robot/R1/observation/3_-4",
        "coadapt/S/robot/R1/beacon/3",
        "coadapt/S/robot/R1/beacon/3_4_5",
        "coadapt/S/robot/R1/beacon/3_4\n",
        "coadapt/S/robot/R1/beacon/1234567_0",
        "coadapt/S/robot/R1/beacon/3_4/5_6",
    ],
)
def test_what_is_no_cell_is_no_key(key: str) -> None:
    with pytest.raises(KeyspaceError):
        keyspace.robot_of(key)


def test_a_swarm_cannot_be_any_swarm() -> None:
    with pytest.raises(KeyspaceError):
        keyspace.beacon(keyspace.ANY, "R1")


@given(st.text(max_size=60))
def test_an_id_comes_only_out_of_our_own_keys(key: str) -> None:
    with pytest.raises(KeyspaceError):
        keyspace.robot_of(key)
