"""`up` starts the console beside the swarm, where the host reaches it under its own name."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from deploy.docker import compose
from deploy.environments import inherited
from deploy.ports import check_free
from deploy.roster import INFRA, Service
from deploy.runtimes.netns import NetnsRuntime
from deploy.services import services
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from options.console.settings import load_settings
from swarm.errors import DeployError
from tests.support.console_swarm import Viewer, ask
from tests.support.deploy_support import WAIT_S, await_
from tests.support.free_ports import free_port


def spec_of(**values: object) -> SwarmSpec:
    common: dict[str, object] = {"robots": ("R1", "R2"), "run_dir": "/r", "var_dir": "/v"}
    return make_spec(**(common | {"console": True} | values))


def console_of(spec: SwarmSpec) -> Service:
    return next(s for s in services(spec, compose.PLACE) if s.name == "console")


def test_its_settings_follow_from_the_swarm() -> None:
    service = console_of(spec_of(swarm="hall", ego="R2", seed=7, console_port=8181))
    settings = load_settings(service.env)
    assert (settings.swarm, settings.ego, settings.world_seed) == ("hall", "R2", 7)
    assert (settings.console_host, settings.console_port) == ("127.0.0.1", 8181)
    assert service.host == INFRA
    assert "console" not in {s.name for s in services(spec_of(console=False), compose.PLACE)}


def test_in_docker_it_answers_on_the_hosts_loopback_and_its_token_stands_in_no_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COADAPT_CONSOLE_TOKEN", "open-sesame")
    text = compose.compose_file(spec_of(runtime="docker"), "image:tag", "llm:tag", "172.17.0.1")
    container = yaml.safe_load(text)["services"]["console"]
    assert container["network_mode"] == "host"
    assert container["cap_drop"] == ["ALL"]
    assert "networks" not in container
    assert container["environment"]["COADAPT_ROUTER"].startswith("tls/127.0.0.1:7447#identity=/")
    assert container["environment"]["COADAPT_CONSOLE_TOKEN"] is None
    assert "open-sesame" not in text
    # Prometheus, in a container, reaches its metrics on the bridge: not its page, nor the world.
    assert container["environment"]["COADAPT_METRICS_HOST"] == "172.17.0.1"
    prometheus = yaml.safe_load(text)["services"]["prometheus"]
    assert "console:host-gateway" in prometheus["extra_hosts"]
    assert "console:9107" in compose.prometheus_file(spec_of(runtime="docker"))


def test_no_other_process_learns_its_token() -> None:
    environment = {"COADAPT_CONSOLE_TOKEN": "open-sesame"}
    assert inherited("console", environment) == environment
    assert inherited("robot", environment) == {}


def test_a_port_that_is_taken_is_named_with_the_option_that_changes_it() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        ports = {name: free_port() for name in ("ego_metrics_port", "qod_port")}
        with pytest.raises(DeployError, match=rf"port {port} on .* console \(--console-port\)"):
            check_free(spec_of(prometheus=False, console_port=port, **ports))


@pytest.fixture
def running(monkeypatch: pytest.MonkeyPatch) -> Iterator[SwarmSpec]:
    """A swarm in network namespaces, with its console."""
    runtime = NetnsRuntime()
    reason = runtime.available()
    if reason is not None:
        pytest.skip(f"network namespaces cannot be made here: {reason}")
    with tempfile.TemporaryDirectory(prefix="ca-", dir="/tmp") as directory:
        monkeypatch.setenv("COADAPT_RUN_DIR", directory)
        spec = make_spec(
            swarm="seen",
            robots=factory_robots(2),
            rings=16,
            prometheus=False,
            console=True,
            console_port=free_port(),
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            run_dir=f"{directory}/seen",
            var_dir=str(Path(directory, "var")),
        )
        try:
            assert runtime.up(spec)
            yield spec
        finally:
            runtime.down("seen")


def answers(port: int) -> bool:
    try:
        return ask(port, "GET", "/").status == 200
    except OSError:
        return False


def test_a_real_swarm_is_seen_and_its_cell_is_shaped_through_the_page(running: SwarmSpec) -> None:
    port = running.console_port
    assert need_state("seen").console_url == f"http://localhost:{port}"
    await_(lambda: answers(port), "the console answers")
    with Viewer(port) as viewer:
        whole = {"decision", "detections", "net", "robot/R1", "robot/R2", "scene/R1", "scene/R2"}
        viewer.until(lambda: viewer.state.keys() >= whole, "the swarm is seen", WAIT_S)
        assert viewer.shape({"profile": "rate", "rate_bps": 3_000_000}).status == 200
        viewer.until(
            lambda: any(
                (link["robot"], link["direction"], link["capacity_bps"])
                == ("R1", "down", 3_000_000)
                for link in viewer.state.get("net", {}).get("links", ())
            ),
            "the cell has the rate",
        )
