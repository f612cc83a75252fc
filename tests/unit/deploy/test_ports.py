"""A swarm takes the usual ports, and the next free ones where these are taken."""

from __future__ import annotations

from typing import Any

import pytest

from deploy.ports import LOCALHOST, based_on, check_free, listen, with_free_ports
from deploy.spec import PORT_FIELDS, SwarmSpec, make_spec
from swarm.errors import DeployError
from tests.support.free_ports import free_ports


def spec_of(**values: Any) -> SwarmSpec:
    return make_spec(
        robots=("R1", "R2"), run_dir="/r", var_dir="/v", console=True, prometheus=False, **values
    )


@pytest.mark.stumble(
    "a port that is taken ends the start", command="make up  # while 8080 is taken"
)
def test_the_next_free_port_is_taken_and_said() -> None:
    console, ego, qod = free_ports(3), free_ports(1), free_ports(1)
    spec = spec_of(console_port=console, ego_metrics_port=ego, qod_port=qod)
    with listen(console, "a test"):
        free, notes = with_free_ports(spec, ())
        assert free.console_port > console
        assert notes == [f"the console: port {free.console_port}, as {console} is taken"]
        listen(free.console_port, "a test").close()
        assert with_free_ports(spec, {"console_port"}) == (spec, [])
    assert with_free_ports(spec, ()) == (spec, [])


def test_no_port_is_given_twice() -> None:
    first = free_ports(4)
    spec = spec_of(console_port=first, ego_metrics_port=first, qod_port=first)
    free, _ = with_free_ports(spec, ())
    assert len({free.console_port, free.ego_metrics_port, free.qod_port}) == 3


def test_the_routers_ports_follow_one_another() -> None:
    base = free_ports(20)
    spec = make_spec(robots=("R1", "R2"), run_dir="/r", var_dir="/v", runtime="docker")
    values = based_on(base)
    spec = make_spec(robots=("R1", "R2"), run_dir="/r", var_dir="/v", runtime="docker", **values)
    with listen(spec.router_port + 2, "a test"):
        free, notes = with_free_ports(spec, ())
        assert free.router_port == spec.router_port + 3
        assert notes == [f"the router: port {free.router_port}, as {spec.router_port} is taken"]
        with pytest.raises(DeployError, match=r"for the router \(--router-port\), cannot be taken"):
            check_free(spec)


def test_ports_from_a_base_do_not_overlap() -> None:
    values = based_on(20_000)
    assert set(values) == set(PORT_FIELDS)
    assert sorted(values.values()) == list(range(20_000, 20_000 + len(PORT_FIELDS)))
    assert max(values, key=lambda name: values[name]) == "router_port"


def test_a_port_that_is_taken_says_what_for() -> None:
    port = free_ports(1)
    words = rf"port {port} on {LOCALHOST}, for the console \(--console-port\)"
    with listen(port, "a test"), pytest.raises(DeployError, match=words):
        listen(port, "the console (--console-port)")
