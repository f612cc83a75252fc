"""A swarm as a stack of Docker Swarm: what is written, and what is said of nodes and tasks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from deploy.cluster import nodes, plan, stack
from deploy.cluster.plan import Cluster, make_cluster
from deploy.docker import compose
from deploy.services import ROUTER_METRICS_PORT, services
from deploy.spec import SwarmSpec, make_spec
from deploy.trust.prepare import keep, keystore_of
from swarm.errors import DeployError
from swarm.trust.members import read_members
from swarm.trust.roles import Role

ROBOTS = ("R1", "R2", "R3")
HOST = make_cluster("registry:5000/coadapt-edge:1", "10.0.0.1")
MODEL = make_cluster("registry:5000/coadapt-edge:1", "10.0.0.1", llm_image="llm:1")
OVERLAY = make_cluster("registry:5000/coadapt-edge:1", "router", "overlay")


def kept(spec: SwarmSpec) -> tuple[str, ...]:
    """Whose certificates were issued so that all have one."""
    return keep(spec, plan.place_of(spec, HOST), plan.roles(spec, MODEL))


@pytest.fixture
def spec(tmp_path: Path) -> SwarmSpec:
    """Three robots and all that a site has, with certificates."""
    made = make_spec(
        swarm="s",
        runtime="swarm",
        robots=ROBOTS,
        ego_standby="R2",
        secure=True,
        console=True,
        prometheus=False,
        llm="http://models:8000",
        var_dir=str(tmp_path),
    )
    kept(made)
    return made


def stacked(spec: SwarmSpec, cluster: Cluster = HOST, **options: Any) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load(stack.stack_file(spec, cluster, **options))
    return document


def test_the_processes_are_those_of_up_but_the_authority_and_its_one_controller(
    spec: SwarmSpec,
) -> None:
    members = {one.name for one in services(spec, plan.place_of(spec, HOST))}
    assert set(stacked(spec)["services"]) == members - {"authority", "controller"}


def test_a_robot_and_its_ego_stay_on_its_node_and_are_never_started_elsewhere(
    spec: SwarmSpec,
) -> None:
    services = stacked(spec)["services"]
    for name, robot in {"robot-R2": "R2", "ego-R1": "R1", "ego-R2": "R2"}.items():
        deploy = services[name]["deploy"]
        assert deploy["mode"] == "global"
        assert deploy["placement"]["constraints"] == [f"node.labels.coadapt.robot == {robot}"]
    for one in services.values():
        # The next task of an id begins after the last one has ended.
        assert one["deploy"]["update_config"]["order"] == "stop-first"
        assert one["deploy"]["rollback_config"]["order"] == "stop-first"
    site = services["router"]["deploy"]
    assert (site["mode"], site["replicas"]) == ("replicated", 1)
    assert site["placement"]["constraints"] == ["node.labels.coadapt.site == true"]
    named = stacked(spec, pin="name")["services"]["robot-R3"]["deploy"]
    assert named["placement"]["constraints"] == ["node.hostname == R3"]


def test_a_task_may_do_no_more_than_its_part(spec: SwarmSpec) -> None:
    for name, one in stacked(spec)["services"].items():
        assert one["cap_drop"] == ["ALL"], name
        assert "cap_add" not in one, name
        assert one["read_only"], name
        assert one["user"] == f"{plan.USER}:{plan.USER}", name
        limits = one["deploy"]["resources"]["limits"]
        assert limits["pids"] == 512, name
        assert int(limits["memory"]) >= 256 << 20, name
        assert one["logging"]["options"] == {"max-size": "10m", "max-file": "3"}, name
        (tmp,) = [v for v in one["volumes"] if v["type"] == "tmpfs"]
        assert (tmp["target"], tmp["tmpfs"]["size"]) == ("/tmp", 64 << 20)
        assert one["environment"]["COADAPT_HOST"] == "{{.Node.Hostname}}"
        assert one["healthcheck"]["test"][-1] == one["environment"].get(
            "COADAPT_METRICS_PORT", str(ROUTER_METRICS_PORT)
        )


def test_a_named_interface_gets_a_controller_on_each_robots_node(spec: SwarmSpec) -> None:
    shaped = msgspec.structs.replace(spec, link_bps=5_000_000)
    cluster = make_cluster("edge:1", "10.0.0.1", interface="eth1", default_route=True)
    keep(shaped, plan.place_of(shaped, cluster), plan.roles(shaped, cluster))
    services = stacked(shaped, cluster)["services"]
    own = {name: one for name, one in services.items() if name.startswith("controller")}
    assert list(own) == ["controller-R1", "controller-R2", "controller-R3"]
    for name, one in own.items():
        robot = name.removeprefix("controller-")
        env = one["environment"]
        assert env["COADAPT_DRIVER"] == "interface"
        assert env["COADAPT_CONTROLLER"] == env["COADAPT_INTERFACE_ROBOTS"] == robot
        assert env["COADAPT_INTERFACE"] == env["COADAPT_INTERFACE_CONFIRMED"] == "eth1"
        assert env.get("COADAPT_LINK_BPS") == ("5000000" if robot == "R1" else None)
        assert env["COADAPT_ROUTER"].endswith(f"/keystore/issued/{name}")
        assert one["cap_drop"] == ["ALL"]
        assert one["cap_add"] == ["NET_ADMIN", "DAC_OVERRIDE"]
        assert one["user"] == "0:0"
        assert one["deploy"]["placement"]["constraints"] == [
            f"node.labels.coadapt.robot == {robot}"
        ]
        assert {Path(held["target"]).parent.name for held in one["secrets"]} == {name}
        assert {held["uid"] for held in one["secrets"]} == {"0"}
    assert not any("cap_add" in one for name, one in services.items() if name not in own)
    unconfirmed = make_cluster("edge:1", "10.0.0.1", interface="eth1")
    env = stacked(shaped, unconfirmed)["services"]["controller-R2"]["environment"]
    assert env["COADAPT_INTERFACE_CONFIRMED"] == ""


def test_in_a_mesh_each_node_has_a_router_that_names_those_before_it(spec: SwarmSpec) -> None:
    # R1's node is the site's, whose router is its own.
    cluster = replace(
        make_cluster("edge:1", "10.0.0.1", interface="eth1"),
        hosts={"R2": "10.0.0.2", "R3": "10.0.0.3"},
    )
    keep(
        spec,
        plan.place_of(spec, cluster),
        plan.roles(spec, cluster),
        plan.router_addresses(cluster),
    )
    services = stacked(spec, cluster)["services"]
    peers = {
        name: [after for word, after in pairwise(one["command"]) if word == "--peer"]
        for name, one in services.items()
        if name.startswith("router")
    }
    assert peers == {
        "router": [],
        "router-R2": ["tls/10.0.0.1:7447"],
        "router-R3": ["tls/10.0.0.1:7447", "tls/10.0.0.2:7447"],
    }
    reached = {
        name: one["environment"]["COADAPT_ROUTER"].partition("#")[0]
        for name, one in services.items()
        if "COADAPT_ROUTER" in one["environment"]
    }
    for name, at in reached.items():
        node = {"R2": "10.0.0.2", "R3": "10.0.0.3"}.get(name.rpartition("-")[2], "10.0.0.1")
        assert at == f"tls/{node}:7447", name
    own = services["router-R3"]
    assert own["command"][own["command"].index("--identity") + 1].endswith("/issued/router-R3")
    assert {Path(one["target"]).parent.name for one in own["secrets"]} == {"router-R3"}
    assert {Path(one["target"]).name for one in own["secrets"]} == {
        *("ca.pem", "cert.pem", "key.pem", "members")
    }
    assert own["deploy"]["placement"]["constraints"] == ["node.labels.coadapt.robot == R3"]
    store = keystore_of(spec.var_dir)
    assert store.addresses("router-R3") == ["10.0.0.3"]
    known = set(read_members(store.identity("router")))
    assert {Role("router", "R2"), Role("router", "R3")} <= known


def test_a_task_gets_its_own_certificate_only(spec: SwarmSpec) -> None:
    document = stacked(spec)
    store = f"{compose.PLACE.var_dir}/keystore/issued"
    for name, own in {"robot-R3": "R3", "ego-R1": "ego-R1", "router": "router"}.items():
        held = document["services"][name]["secrets"]
        files = {"ca.pem", "cert.pem", "key.pem"} | ({"members"} if own == "router" else set())
        assert {one["target"] for one in held} == {f"{store}/{own}/{file}" for file in files}
        assert {one["mode"] for one in held} == {0o400}
        for one in held:
            source = document["secrets"][one["source"]]
            assert Path(source["file"]).parent.name == own
    assert "ca/key.pem" not in stack.stack_file(spec, HOST)
    assert "BEGIN" not in stack.stack_file(spec, HOST)


def test_what_is_renewed_is_another_secret_and_what_is_not_is_the_same(spec: SwarmSpec) -> None:
    before = stacked(spec)
    assert kept(spec) == ()
    assert stacked(spec) == before
    cert = Path(before["secrets"]["R2-cert.pem"]["file"])
    cert.unlink()
    assert kept(spec) == ("R2",)
    after = stacked(spec)["secrets"]
    changed = {key for key in after if after[key]["name"] != before["secrets"][key]["name"]}
    assert changed == {"R2-cert.pem", "R2-key.pem"}


def test_names_of_secrets_fit_the_engine(tmp_path: Path) -> None:
    long = "S" * 32
    spec = make_spec(
        swarm=long, robots=("a" * 28, "b" * 28), secure=True, prometheus=False,
        runtime="swarm", var_dir=str(tmp_path),
    )  # fmt: skip
    kept(spec)
    document = stacked(spec)
    names = [one["name"] for one in document["secrets"].values()]
    assert all(len(name) <= stack.MAX_NAME for name in names)
    files = {one["name"]: Path(one["file"]).read_bytes() for one in document["secrets"].values()}
    for one in document["secrets"].values():
        assert files[one["name"]] == Path(one["file"]).read_bytes()


def test_on_the_hosts_network_all_reach_the_router_at_its_address(spec: SwarmSpec) -> None:
    document = stacked(spec)
    assert document["networks"] == {"host": {"external": True, "name": "host"}}
    assert {tuple(one["networks"]) for one in document["services"].values()} == {("host",)}
    address = document["services"]["robot-R3"]["environment"]["COADAPT_ROUTER"]
    assert address.startswith("tls/10.0.0.1:7447#identity=")
    assert not any("ports" in one for one in document["services"].values())
    assert stack.loses(HOST) == ""


def test_an_overlay_has_no_virtual_addresses_and_says_what_it_loses(
    spec: SwarmSpec, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    token = tmp_path / "token"
    token.write_text("secret")
    monkeypatch.setenv("COADAPT_CONSOLE_TOKEN_FILE", str(token))
    document = stacked(spec, OVERLAY)
    services = document["services"]
    assert document["networks"] == {"wire": {"driver": "overlay"}}
    assert {one["deploy"]["endpoint_mode"] for one in services.values()} == {"dnsrr"}
    assert {one["mode"] for s in services.values() for one in s.get("ports", ())} == {"host"}
    assert services["robot-R2"]["environment"]["COADAPT_ROUTER"].startswith("tls/router:7447#")
    assert services["console"]["environment"]["COADAPT_CONSOLE_HOST"] == "0.0.0.0"
    assert "DSCP" in stack.loses(OVERLAY)


def config_of(spec: SwarmSpec, cluster: Cluster, homes: dict[str, str]) -> list[dict[str, Any]]:
    """What Prometheus scrapes."""
    config = yaml.safe_load(stack.prometheus_file(spec, cluster, homes))
    found: list[dict[str, Any]] = config["scrape_configs"]
    return found


def test_prometheus_finds_every_process_and_answers_its_own_node_only(spec: SwarmSpec) -> None:
    watched = msgspec.structs.replace(spec, prometheus=True)
    homes = {"R1": "10.0.0.1", "R2": "10.0.0.2", "R3": "10.0.0.3"}
    for cluster, known in ((HOST, homes), (OVERLAY, {})):
        found = {
            target["labels"]["instance"]: target["targets"][0]
            for job in config_of(watched, cluster, known)
            for target in job.get("static_configs", ())
        }
        assert set(found) == set(stack.names(watched, cluster))
        on_host = cluster is HOST
        assert found["robot-R3"] == ("10.0.0.3:9101" if on_host else "robot-R3:9101")
        assert found["ego-R2"] == ("10.0.0.2:9102" if on_host else "ego-R2:9102")
        assert found["prometheus"] == ("127.0.0.1:9090" if on_host else "prometheus:9090")
        assert found["router"] == ("10.0.0.1:9100" if on_host else "router:9100")
    text = stack.stack_file(watched, HOST, prometheus="a: 1")
    again = stack.stack_file(watched, HOST, prometheus="a: 2")
    document = yaml.safe_load(text)
    assert document["configs"]["prometheus"]["file"] == str(stack.config_path(watched))
    assert document["configs"] != yaml.safe_load(again)["configs"]
    prometheus, router = (document["services"][name] for name in ("prometheus", "router"))
    # Who joins is told from the one to the other.
    (joined,) = (j for j in config_of(watched, HOST, homes) if "static_configs" not in j)
    (file,) = joined["file_sd_configs"][0]["files"]
    assert router["command"][router["command"].index("--targets") + 1] == file
    shared = {"type": "volume", "source": "targets", "target": str(Path(file).parent)}
    assert shared in router["volumes"]
    assert shared in prometheus["volumes"]
    assert joined["tls_config"]["ca_file"] in {one["target"] for one in prometheus["secrets"]}
    assert "--web.listen-address=127.0.0.1:9090" in prometheus["command"]
    assert [one["source"] for one in prometheus["configs"]] == ["prometheus"]


def test_metrics_over_tls_are_asked_for_so(spec: SwarmSpec) -> None:
    watched = msgspec.structs.replace(spec, prometheus=True, metrics_tls=True)
    config = yaml.safe_load(stack.prometheus_file(watched, OVERLAY, {}))
    ca = f"{compose.PLACE.var_dir}/keystore/ca/ca.pem"
    for job in config["scrape_configs"]:
        own = job["job_name"] == "prometheus"
        assert job.get("scheme", "http") == ("http" if own else "https")
        assert own or job["tls_config"]["ca_file"] == ca
    services = yaml.safe_load(stack.stack_file(watched, HOST, prometheus="a: 1"))["services"]
    assert [one["target"] for one in services["prometheus"]["secrets"]] == [ca]
    for name, one in services.items():
        assert ("--tls" in one["healthcheck"]["test"]) == (name != "prometheus")


def test_a_console_that_answers_off_its_node_needs_a_token(spec: SwarmSpec) -> None:
    with pytest.raises(DeployError, match="COADAPT_CONSOLE_TOKEN_FILE"):
        stack.stack_file(spec, OVERLAY)


def test_only_some_processes_are_written_when_asked_for(spec: SwarmSpec) -> None:
    document = stacked(spec, only=["robot-R3"])
    assert list(document["services"]) == ["robot-R3"]
    assert set(document["secrets"]) == {"R3-ca.pem", "R3-cert.pem", "R3-key.pem"}
    with pytest.raises(DeployError, match="--only 'robot-R9' is not a process"):
        stack.stack_file(spec, HOST, only=["robot-R9"])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"image": ""}, "name it by --image or COADAPT_IMAGE"),
        ({"image": "Edge:1"}, "--image 'Edge:1' is not valid"),
        ({"image": "a b"}, "--image 'a b' is not valid"),
        ({"image": "edge@sha256:12"}, "--image 'edge@sha256:12' is not valid"),
        ({"image": "edge", "router": "tls/host"}, "--router 'tls/host' is not valid"),
        ({"image": "edge", "interface": "eth 1"}, "--interface 'eth 1' is not the name"),
        ({"image": "edge", "interface": "eth1", "network": "overlay"}, "needs --network host"),
    ],
)
def test_what_the_machines_could_not_use_is_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(DeployError, match=said):
        make_cluster(**{"router": "host", **values})


@pytest.mark.parametrize(
    "image", ["edge", "a/b-c:1.2_x", "h.example:5000/a/b:t@sha256:" + "0" * 64, "10.0.0.1:5/x"]
)
def test_names_of_images_are_taken_as_engines_take_them(image: str) -> None:
    assert make_cluster(image, "host").image == image


def test_a_secrets_value_is_never_written(
    spec: SwarmSpec, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COADAPT_LLM_API_KEY", "sk-secret")
    with pytest.raises(DeployError, match="name a file that holds it by COADAPT_LLM_API_KEY_FILE"):
        stack.stack_file(spec, HOST)
    monkeypatch.delenv("COADAPT_LLM_API_KEY")
    key = tmp_path / "key"
    key.write_text("sk-secret")
    monkeypatch.setenv("COADAPT_LLM_API_KEY_FILE", str(key))
    document = stacked(spec)
    assert "sk-secret" not in stack.stack_file(spec, HOST)
    gateway = document["services"]["gateway"]
    assert gateway["environment"]["COADAPT_LLM_API_KEY_FILE"] == compose.KEY
    assert compose.KEY in {one["target"] for one in gateway["secrets"]}
    for name, one in document["services"].items():
        names = set(one["environment"])
        assert ("COADAPT_LLM_API_KEY_FILE" in names) == (name == "gateway"), name


def test_a_dollar_sign_in_a_setting_means_itself(
    spec: SwarmSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COADAPT_HEADROOM", "$HOME")
    assert stacked(spec)["services"]["ego-R1"]["environment"]["COADAPT_HEADROOM"] == "$$HOME"


def test_the_embedded_model_needs_an_image_that_has_it(tmp_path: Path) -> None:
    spec = make_spec(robots=ROBOTS, llm="embedded", runtime="swarm", var_dir=str(tmp_path))
    with pytest.raises(DeployError, match="--llm-image"):
        plan.containers(spec, HOST)
    with_model = make_cluster("edge:1", "host", llm_image="edge-llm:1")
    images = {c.service.role: c.image for c in plan.containers(spec, with_model)}
    assert (images["gateway"], images["robot"]) == ("edge-llm:1", "edge:1")


def node(name: str, state: str = "ready", availability: str = "active", **labels: str) -> Any:
    """A node as `docker node inspect` tells of it."""
    return {
        "Description": {"Hostname": name},
        "Spec": {
            "Availability": availability,
            "Labels": {f"coadapt.{key}": value for key, value in labels.items()},
        },
        "Status": {"State": state},
    }


def test_robots_without_a_node_or_with_two_are_named(spec: SwarmSpec) -> None:
    well = [node("n1", robot="R1", site="true"), node("n2", robot="R2"), node("n3", robot="R3")]
    assert nodes.node_problems(spec, well, "label") == []
    amiss = [node("n1", robot="R1"), node("n2", robot="R2"), node("n4", robot="R2")]
    assert nodes.node_problems(spec, amiss, "label") == [
        "robot R2 has 2 nodes, n2, n4, and each would run it: an id must be there once",
        "robot R3 has no node: `docker node update --label-add coadapt.robot=R3 NODE`",
        "the router has no node: `docker node update --label-add coadapt.site=true NODE`",
    ]
    gone = [node("n1", robot="R1", site="true"), node("n2", "down", robot="R2"),
            node("n3", availability="drain", robot="R3", site="true")]  # fmt: skip
    assert nodes.node_problems(spec, gone, "label") == [
        "n1, n3 have the label coadapt.site: the router is to have one address",
        "node n2 is down",
        "node n3 is set to drain",
    ]
    named = [node(robot, site=str(robot == "R1").lower()) for robot in ROBOTS]
    assert nodes.node_problems(spec, named, "name") == []


def test_a_managers_own_address_is_where_managers_meet(
    spec: SwarmSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [node("n1", robot="R1"), node("n2", robot="R2"), node("n3", robot="R3")]
    for number, one in enumerate(found, 1):
        one["Status"]["Addr"] = f"10.0.0.{number}"
    found[0]["Status"]["Addr"] = "0.0.0.0"
    found[0]["ManagerStatus"] = {"Addr": "10.0.0.1:2377"}
    monkeypatch.setattr(nodes, "_nodes", lambda: found)
    known = {"R1": "10.0.0.1", "R2": "10.0.0.2", "R3": "10.0.0.3"}
    assert nodes.addresses(spec, "label") == known
    del found[2]
    with pytest.raises(DeployError, match="robot R3's node, and it has 0"):
        nodes.addresses(spec, "label")


def test_a_task_that_does_not_run_is_told_with_the_engines_reason() -> None:
    services = {"robot-R1": "c_robot-R1", "robot-R2": "c_robot-R2", "router": "c_router",
                "robot-R10": "c_robot-R10", "console": ""}  # fmt: skip
    ps = [
        {"name": "c_robot-R1.x", "node": "n1", "state": "Running 2 minutes ago", "error": ""},
        {"name": "c_robot-R2.y", "node": "n2", "state": "Rejected 1 second ago",
         "error": "No such image: r:5000/edge:1"},
        {"name": "c_router.1", "node": "n1", "state": "Preparing 9 seconds ago", "error": ""},
    ]  # fmt: skip
    assert nodes.task_problems(services, ps) == [
        "robot-R2 does not run on n2: No such image: r:5000/edge:1",
        "router does not run yet: Preparing 9 seconds ago",
        "robot-R10 has no task",
        "console is not deployed",
    ]
