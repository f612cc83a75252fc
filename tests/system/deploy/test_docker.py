"""A whole swarm in containers, started and seen through the command line."""

from __future__ import annotations

import json
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from deploy import state as record
from deploy.docker import compose
from deploy.prometheus import Prometheus
from deploy.runtimes.docker import DockerRuntime, gateway_of
from deploy.services import services
from deploy.spec import SwarmSpec, make_spec
from deploy.state import State, need_state
from swarm.errors import DeployError
from tests.support.command_line import Cli, command_line
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port, free_ports

# The first start builds the image: wheels, and a base where none can be pulled.
READY_S = 900
SWARM = "boxed"
pytestmark = pytest.mark.timeout(READY_S)


def networks() -> list[Any]:
    """The swarm's networks."""
    import docker

    found: list[Any] = docker.from_env().networks.list(
        filters={"label": f"{compose.LABEL}={SWARM}"}
    )
    return found


def ifbs() -> set[str]:
    """Devices that the controller makes on the host for traffic from containers."""
    return {name for _, name in socket.if_nameindex() if name.startswith("ifb-")}


def containers() -> dict[str, Any]:
    """The swarm's containers by service."""
    import docker

    found = docker.from_env().containers.list(
        all=True, filters={"label": f"{compose.LABEL}={SWARM}"}
    )
    return {c.labels[compose.SERVICE_LABEL]: c for c in found}


@pytest.fixture(scope="module")
def cli() -> Iterator[Cli]:
    """Runs `coadapt` as a user does, in this swarm."""
    why_not = DockerRuntime().available()
    if why_not is not None:
        pytest.skip(why_not)
    with command_line("--swarm", SWARM, timeout_s=READY_S, run_dir="run") as run:
        yield run


@pytest.fixture(scope="module")
def up() -> tuple[str, ...]:
    """The command that starts the swarm."""
    return (
        *("up", "--runtime", "docker", "--robots", "3", "--rings", "16", "--wait", "120"),
        *("--prometheus-port", str(free_port()), "--ego-metrics-port", str(free_port())),
        *("--router-port", str(free_ports(3)), "--qod-port", str(free_port())),
        *("--controller-metrics-port", str(free_port()), "--console-port", str(free_port())),
        *("--console-metrics-port", str(free_port())),
    )


@pytest.fixture(scope="module")
def swarm(cli: Cli, up: tuple[str, ...]) -> Iterator[State]:
    """Three robots, alive, and an ego that has decided."""
    done = cli(*up)
    assert done.returncode == 0, done.stderr
    yield need_state(SWARM)
    assert cli("down").returncode == 0
    assert not containers()


def test_every_process_is_a_container_and_the_ego_decides(swarm: State, cli: Cli) -> None:
    assert set(containers()) == {
        *("authority", "router", "controller", "robot-R1", "robot-R2", "robot-R3", "ego-R1"),
        *("console", "prometheus"),
    }
    done = cli("status", "--json")
    assert done.returncode == 0, done.stderr
    table = json.loads(done.stdout)
    assert all(robot["alive"] for robot in table["robots"])
    assert table["selected"][0] == "R1"
    assert table["valid"]
    assert all(robot["position"] is not None for robot in table["robots"])


def test_robots_send_what_the_ego_asks_for(swarm: State) -> None:
    prometheus = Prometheus(swarm.prometheus_url)
    total = "sum by (robot) (coadapt_ego_received_bytes_total)"

    def senders() -> set[str]:
        return {s.labels["robot"] for s in prometheus.query(total) if s.value > 0}

    await_(lambda: senders() == {"R2", "R3"}, "bytes of both robots are counted")


def test_prometheus_reaches_every_container(swarm: State) -> None:
    prometheus = Prometheus(swarm.prometheus_url)

    def up() -> set[str]:
        return {target.instance for target in prometheus.targets() if target.health == "up"}

    await_(lambda: up() == set(containers()), "every container is a target that is up")


def test_a_killed_robot_comes_back(swarm: State) -> None:
    robot = containers()["robot-R2"]
    before = robot.attrs["State"]["StartedAt"]
    robot.exec_run(["sh", "-c", "kill -9 -1"], user="root")

    def back() -> bool:
        robot.reload()
        facts = robot.attrs["State"]
        return bool(facts["Running"]) and facts["StartedAt"] != before

    await_(back, "the container runs again")
    status = {s.service: s for s in DockerRuntime().status(SWARM)}
    assert status["robot-R2"].state == "running"
    assert status["robot-R2"].restarts == 1


def links_of(cli: Cli) -> dict[tuple[str, str], dict[str, Any]]:
    """What the controller says of the shaped links, by robot and direction."""
    done = cli("net", "show", "--json")
    assert done.returncode == 0, done.stderr
    return {(k["robot"], k["direction"]): k for k in json.loads(done.stdout).get("links", [])}


def test_both_directions_of_containers_links_are_shaped_and_carry_telemetry(
    swarm: State, cli: Cli
) -> None:
    assert cli("net", "shape", "--rate", "3mbit").returncode == 0
    up = cli("net", "shape", "--rate", "2mbit", "--robot", "R2", "--direction", "up")
    assert up.returncode == 0, up.stderr

    def shaped() -> bool:
        links = links_of(cli)
        return {k: v["capacity_bps"] for k, v in links.items()} == {
            ("R1", "down"): 3_000_000,
            ("R2", "up"): 2_000_000,
        } and links["R2", "up"]["classes"]["fusion"]["sent_bytes"] > 0

    await_(shaped, "both links are shaped, and fusion comes from R2")
    done = cli("net", "congest", "--for", "20s")
    assert done.returncode == 0, done.stderr
    await_(
        lambda: links_of(cli)["R1", "down"]["classes"]["background"]["throughput_bps"] > 1_000_000,
        "telemetry fills the cell",
    )


def host_end(service: str) -> str:
    """The interface of this host that a container's link ends at; empty while it has none."""
    done = containers()[service].exec_run(["cat", "/sys/class/net/eth0/iflink"])
    names = dict(socket.if_nameindex())
    return names.get(int(done.output), "") if done.exit_code == 0 else ""


def test_a_container_that_was_restarted_is_shaped_again(swarm: State, cli: Cli) -> None:
    assert cli("net", "shape", "--rate", "3mbit").returncode == 0
    before = host_end("ego-R1")
    containers()["ego-R1"].restart(timeout=1)

    def shaped() -> bool:
        name = host_end("ego-R1")
        shown = subprocess.run(["tc", "qdisc", "show", "dev", name], capture_output=True, text=True)
        return name not in ("", before) and "htb" in shown.stdout

    await_(shaped, "the new interface is shaped")
    await_(lambda: ("R1", "down") in links_of(cli), "the controller shows it")


def test_a_controller_that_is_killed_comes_back_to_its_links(swarm: State, cli: Cli) -> None:
    assert cli("net", "shape", "--rate", "4mbit").returncode == 0
    controller = containers()["controller"]
    controller.exec_run(["sh", "-c", "kill -9 -1"])
    await_(
        lambda: "adopted" in cli("logs", "controller").stdout,
        "the next controller adopts what it finds",
    )
    await_(
        lambda: links_of(cli).get(("R1", "down"), {}).get("capacity_bps") == 4_000_000,
        "the controller shows the rate that it took over",
    )


def test_a_containers_root_cannot_be_written(swarm: State) -> None:
    status, said = containers()["robot-R1"].exec_run(["touch", "/app/something"])
    assert status != 0
    assert b"Read-only file system" in said


def test_up_twice_is_harmless_and_other_settings_are_refused(
    swarm: State, cli: Cli, up: tuple[str, ...]
) -> None:
    before = {name: c.id for name, c in containers().items()}
    again = cli(*up)
    assert again.returncode == 0
    assert "runs already" in again.stderr
    other = cli(*up, "--policy", "static-late")
    assert other.returncode == 1
    said = (
        "already runs with policy 'coverage' (wanted: 'static-late'); run `make down SWARM=boxed`"
    )
    assert said in other.stderr
    assert {name: c.id for name, c in containers().items()} == before


@pytest.mark.stumble(
    "a second swarm of one name takes the first one down", command="make up SWARM=local  # twice"
)
def test_somebody_elses_swarm_of_this_name_is_left_alone(
    swarm: State, cli: Cli, up: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {name: c.id for name, c in containers().items()}
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    for command in (up, ("down",)):
        done = cli(*command)
        assert done.returncode == 1
        assert f"another swarm {SWARM!r} runs in this Docker engine" in done.stderr
        assert swarm.spec.run_dir in done.stderr
    assert {name: c.id for name, c in containers().items()} == before


def test_logs_are_the_containers_output(swarm: State, cli: Cli) -> None:
    done = cli("logs", "router")
    assert done.returncode == 0
    assert "router_up" in done.stdout
    assert cli("logs", "nobody").returncode == 1


def test_down_clears_what_a_crash_left_behind(cli: Cli, up: tuple[str, ...], swarm: State) -> None:
    # No controller can tidy up, and the record is lost, as after a crash of `up`: the containers'
    # labels are enough.
    up_link = cli("net", "shape", "--rate", "2mbit", "--robot", "R2", "--direction", "up")
    assert up_link.returncode == 0, up_link.stderr
    assert ifbs()
    containers()["controller"].kill()
    record.remove_run_dir(SWARM)
    done = cli("down")
    assert done.returncode == 0
    await_(lambda: not containers(), "no container is left")
    assert not networks()
    assert not ifbs()
    done = cli("down")
    assert done.returncode == 0
    assert "no swarm" in done.stderr + done.stdout


def composed(spec: SwarmSpec) -> dict[str, Any]:
    """The services of a swarm's compose file."""
    text = compose.compose_file(spec, "image:tag", "llm:tag", "172.17.0.1")
    services: dict[str, Any] = yaml.safe_load(text)["services"]
    return services


def test_settings_without_an_option_reach_robots_and_egos(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COADAPT_HEADROOM", "0.7")
    monkeypatch.setenv("COADAPT_SWARM", "another")
    monkeypatch.setenv("COADAPT_RUN_DIR", "/tmp/somewhere")
    spec = make_spec(swarm="named", robots=("R1", "R2"), runtime="docker")
    services = composed(spec)
    for name in ("robot-R2", "ego-R1"):
        assert services[name]["environment"]["COADAPT_HEADROOM"] == "0.7"
        assert services[name]["environment"]["COADAPT_SWARM"] == "named"
        assert "COADAPT_RUN_DIR" not in services[name]["environment"]
    assert "COADAPT_HEADROOM" not in services["router"]["environment"]


@pytest.mark.parametrize("runtime", ["docker", "netns"])
def test_numerical_threads_are_few_and_never_spin(runtime: str) -> None:
    spec = make_spec(swarm="s", robots=("R1", "R2"), runtime=runtime, run_dir="/r", var_dir="/v")
    if runtime == "docker":
        settings = {name: s["environment"] for name, s in composed(spec).items()}
    else:
        settings = {s.name: s.env for s in services(spec, compose.PLACE)}
    for name, threads in {"robot-R1": "1", "robot-R2": "1", "ego-R1": "2"}.items():
        assert settings[name]["OMP_NUM_THREADS"] == threads
        assert settings[name]["OMP_WAIT_POLICY"] == "PASSIVE"


def test_a_bridge_whose_gateway_is_not_told_has_the_subnets_first_address() -> None:
    ipv6 = {"Subnet": "fd00::/64", "Gateway": ""}
    assert gateway_of([{"Subnet": "172.17.0.0/16"}, ipv6]) == "172.17.0.1"
    assert gateway_of([{"Subnet": "10.1.0.0/24", "Gateway": "10.1.0.9"}, ipv6]) == "10.1.0.9"
    with pytest.raises(DeployError, match="has no gateway"):
        gateway_of([])


def test_nothing_large_is_kept_in_a_containers_memory() -> None:
    services = composed(make_spec(robots=("R1", "R2"), llm="embedded", runtime="docker"))
    gateway = services["gateway"]
    cache = gateway["environment"]["XDG_CACHE_HOME"]
    mounted = [volume.split(":")[1:] for volume in gateway["volumes"]]
    assert any(cache.startswith(f"{at}/") and mode != ["ro"] for at, *mode in mounted)
    for service in services.values():
        (tmp,) = service["tmpfs"]
        assert tmp.startswith("/tmp:")
        assert "size=64m" in tmp.split(",")


def test_the_compose_file_shows_one_container_a_process() -> None:
    spec = make_spec(swarm="Named", robots=("R1", "R2"), ego="R2", runtime="docker")
    services = composed(spec)
    assert list(services) == [
        *("authority", "router", "controller", "robot-R1", "robot-R2", "ego-R2", "prometheus")
    ]
    own = "/var/coadapt/keystore/issued/ego-R2"
    assert services["ego-R2"]["environment"]["COADAPT_ROUTER"] == f"tls/router:7447#identity={own}"
    assert all("127.0.0.1:" in port for s in services.values() for port in s.get("ports", []))
    assert services["controller"]["network_mode"] == "host"
    assert services["controller"]["cap_drop"] == ["ALL"]
    assert services["controller"]["environment"]["COADAPT_METRICS_HOST"] == "172.17.0.1"
    assert compose.project_of("Named").startswith("coadapt-named-")
    assert compose.project_of("named") == "coadapt-named"


def test_a_container_sees_its_own_certificate_only() -> None:
    spec = make_spec(swarm="s", robots=("R1", "R2"), runtime="docker", console=True, var_dir="/v")
    services = composed(spec)
    seen = {name: [v for v in one["volumes"] if "keystore" in v] for name, one in services.items()}
    own = {name: name for name in ("router", "controller", "console", "ego-R1")}
    for name, identity in (own | {"robot-R1": "R1", "robot-R2": "R2"}).items():
        place = f"keystore/issued/{identity}"
        assert seen[name] == [f"/v/{place}:/var/coadapt/{place}:ro"]
    assert seen["authority"] == ["/v/keystore:/var/coadapt/keystore"]
    # Who joins from elsewhere may serve metrics over TLS; that certificate is no secret.
    assert seen["prometheus"] == ["/v/keystore/ca/ca.pem:/var/coadapt/keystore/ca/ca.pem:ro"]


def test_a_plain_swarm_in_docker_is_had_by_wish() -> None:
    services = composed(make_spec(swarm="s", robots=("R1", "R2"), runtime="docker", secure=False))
    assert "authority" not in services
    assert services["ego-R1"]["environment"]["COADAPT_ROUTER"] == "tcp/router:7447"
    assert not any("keystore" in v for one in services.values() for v in one["volumes"])


def test_no_container_may_do_more_than_its_part() -> None:
    parts = composed(
        make_spec(swarm=SWARM, robots=("R1", "R2"), llm="embedded", console=True, runtime="docker")
    )
    for name, one in parts.items():
        assert one["cap_drop"] == ["ALL"], name
        assert one.get("cap_add", []) == (
            ["NET_ADMIN", "DAC_OVERRIDE"] if name == "controller" else []
        )
        assert one["security_opt"] == ["no-new-privileges:true"], name
        assert one["read_only"], name
        assert one["pids_limit"] == 512, name
        assert one["mem_limit"].endswith(("m", "g")), name
        assert one["logging"]["options"] == {"max-size": "10m", "max-file": "3"}
        written = [v.split(":")[1] for v in one["volumes"] if not v.endswith(":ro")]
        assert len([path for path in written if path.startswith("/var/coadapt/")]) <= 1, name
        assert "/var/coadapt" not in written, name


def test_the_gateway_runs_from_its_own_image_where_a_server_on_the_host_answers() -> None:
    spec = make_spec(swarm="s", robots=("R1", "R2"), runtime="docker", llm="embedded")
    gateway = composed(spec)["gateway"]
    assert (gateway["image"], gateway["network_mode"]) == ("llm:tag", "host")
    router = gateway["environment"]["COADAPT_ROUTER"]
    assert router == "tls/127.0.0.1:7447#identity=/var/coadapt/keystore/issued/gateway"
    assert "ports" not in gateway
    assert {s["image"] for n, s in composed(spec).items() if n != "gateway"} == {"image:tag"}


def test_keys_and_tokens_stand_in_no_file_and_reach_only_whom_they_are_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COADAPT_LLM_API_KEY", "sk-secret")
    monkeypatch.setenv("COADAPT_LLM_API_KEY_FILE", str(tmp_path / "key"))
    monkeypatch.setenv("COADAPT_QOD_TOKEN", "qod-secret")
    monkeypatch.setenv("COADAPT_LLM_HTTP_TOKEN_FILE", str(tmp_path / "token"))
    spec = make_spec(swarm="s", robots=("R1", "R2"), runtime="docker", llm="http://h:1/v1")
    text = compose.compose_file(spec, "image:tag", "llm:tag", "172.17.0.1")
    assert "sk-secret" not in text
    assert "qod-secret" not in text
    services = composed(spec)
    gateway = services.pop("gateway")
    # Compose takes the value of a variable without one from its own environment.
    assert gateway["environment"]["COADAPT_LLM_API_KEY"] is None
    assert gateway["environment"]["COADAPT_LLM_API_KEY_FILE"] == compose.KEY
    assert f"{tmp_path / 'key'}:{compose.KEY}:ro" in gateway["volumes"]
    inside = gateway["environment"]["COADAPT_LLM_HTTP_TOKEN_FILE"]
    assert f"{tmp_path / 'token'}:{inside}:ro" in gateway["volumes"]
    for name, service in services.items():
        names = set(service["environment"])
        assert not any(one.startswith("COADAPT_LLM_API_KEY") for one in names), name
        assert not any("/run/secrets" in one for one in service.get("volumes", ())), name
        assert ("COADAPT_QOD_TOKEN" in names) == (name == "controller")
