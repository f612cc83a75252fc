"""A swarm that others reach: on which addresses, and only with certificates off the loopback."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from cryptography import x509

from deploy.docker import compose
from deploy.ports import ROUTER, listen_endpoints, ports_of
from deploy.services import services
from deploy.spec import SwarmSpec, make_spec
from deploy.trust.prepare import prepare
from swarm.errors import DeployError
from swarm.trust.certificates import read_certificate
from swarm.trust.identity import Identity
from swarm.trust.roles import LOCAL
from tests.support.free_ports import free_ports


def spec_of(**values: Any) -> SwarmSpec:
    values.setdefault("prometheus", False)
    values.setdefault("var_dir", "/v")
    return make_spec(robots=("R1", "R2"), run_dir="/r", **values)


def test_a_swarm_that_others_reach_is_secure_without_being_asked() -> None:
    assert spec_of(listen="198.51.100.7").secure
    assert not spec_of(listen="127.0.0.1").secure
    assert not spec_of().secure


def test_a_plain_swarm_listens_on_the_loopback_only() -> None:
    assert spec_of(listen="127.0.0.1", secure=False).listen == "127.0.0.1"
    with pytest.raises(
        DeployError, match=r"listen = '198.51.100.7'.*loopback.*whoever reaches its"
    ):
        spec_of(listen="198.51.100.7", secure=False)


@pytest.mark.parametrize("address", ["0.0.0.0", "224.0.0.1", "host", "10.0.0.1/8", "::1", "1.2.3"])
def test_what_others_cannot_type_is_no_address(address: str) -> None:
    with pytest.raises(DeployError, match="an IPv4 address of this machine, like"):
        spec_of(listen=address)


def test_in_namespaces_the_routers_ports_are_taken_at_that_address() -> None:
    port, own = free_ports(3), free_ports(2)
    spec = spec_of(listen="127.0.0.1", router_port=port, ego_metrics_port=own, qod_port=own + 1)
    with listen_endpoints(spec) as endpoints:
        taken = [endpoints[name].getsockname() for name in ROUTER]
    assert taken == [("127.0.0.1", port + number) for number in range(3)]
    assert not any(use.field == "router_port" for use in ports_of(spec_of()))


def test_an_address_of_another_machine_is_named() -> None:
    with (
        pytest.raises(DeployError, match=r"on 198.51.100.7, for the router \(--router-port\)"),
        listen_endpoints(spec_of(listen="198.51.100.7")),
    ):
        pass


def test_containers_publish_the_router_there_beside_the_loopback() -> None:
    spec = spec_of(listen="198.51.100.7", runtime="docker")
    project = yaml.safe_load(compose.compose_file(spec, "image", "image", "172.17.0.1"))
    hosts = {port.partition(":")[0] for port in project["services"]["router"]["ports"]}
    assert hosts == {"127.0.0.1", "198.51.100.7"}
    assert len(project["services"]["router"]["ports"]) == 6


def test_the_routers_certificate_is_for_that_address(tmp_path: Path) -> None:
    spec = spec_of(listen="198.51.100.7", var_dir=str(tmp_path))
    prepare(spec, compose.place_of(spec), LOCAL)
    identity = Identity(tmp_path / "keystore" / "issued" / "router")
    names = read_certificate(identity.certificate).extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    assert "198.51.100.7" in {str(name.value) for name in names.value}


def test_a_simulated_world_may_have_room_for_robots_that_join() -> None:
    spec = spec_of(world_robots=6)
    rooms = {
        member.env["COADAPT_WORLD_ROBOTS"]
        for member in services(spec, compose.place_of(spec))
        if "COADAPT_WORLD_ROBOTS" in member.env
    }
    assert rooms == {"6"}
    with pytest.raises(DeployError, match="3 at least, as that many are started"):
        make_spec(robots=("R1", "R2", "R3"), run_dir="/r", var_dir="/v", world_robots=2)
