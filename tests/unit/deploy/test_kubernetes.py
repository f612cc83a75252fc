"""A swarm as objects of Kubernetes: checked against the API's published schemas, and against each
other."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from deploy.cluster import charts, kubernetes, plan, site
from deploy.cluster.plan import Cluster, make_cluster
from deploy.docker import compose
from deploy.spec import SwarmSpec, make_spec
from deploy.trust.prepare import keep
from swarm.errors import DeployError

kubernetes_validate = pytest.importorskip("kubernetes_validate")

OLDEST, NEWEST = "1.35", "1.37"
"""The versions of Kubernetes that are supported (docs/kubernetes.md)."""
FOREIGN = "monitoring.coreos.com"
"""Kinds of Prometheus' operator, which are not the API's own."""
ROBOTS = ("R1", "arm_2", "R3")
HOST = make_cluster("registry:5000/coadapt-edge:1", site.ROUTER)
MODEL = make_cluster("registry:5000/edge:1", site.ROUTER, llm_image="registry:5000/llm:1")
Object = dict[str, Any]


def kept(spec: SwarmSpec) -> tuple[str, ...]:
    """Whose certificates were issued so that all have one."""
    return keep(spec, plan.place_of(spec, HOST), plan.roles(spec, MODEL))


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SwarmSpec:
    """Three robots and all that a site has, with certificates and a token of the operator's."""
    token = tmp_path / "token"
    token.write_text("secret")
    monkeypatch.setenv("COADAPT_CONSOLE_TOKEN_FILE", str(token))
    recorded = tmp_path / "recorded"
    recorded.mkdir()
    made = make_spec(
        swarm="s",
        runtime="kubernetes",
        robots=ROBOTS,
        ego_standby="arm_2",
        world="scans",
        data=str(recorded),
        secure=True,
        console=True,
        prometheus=False,
        llm="embedded",
        var_dir=str(tmp_path),
    )
    kept(made)
    return made


@pytest.fixture(params=["host", "overlay", "interface", "mesh"])
def cluster(request: pytest.FixtureRequest, spec: SwarmSpec) -> Cluster:
    """On the nodes' own network, on the cluster's, with a controller on each robot's node, and with
    a router there."""
    image, model = "registry:5000/coadapt-edge:1", "registry:5000/coadapt-llm:1"
    if request.param in ("host", "overlay"):
        return make_cluster(image, site.ROUTER, request.param, model)
    if request.param == "mesh":
        made = make_cluster(image, site.ROUTER, "host", model)
        made = replace(made, hosts=kubernetes.own_routers(spec))
    else:
        made = make_cluster(image, site.ROUTER, "host", model, "eth1")
    keep(spec, plan.place_of(spec, made), plan.roles(spec, made), plan.router_addresses(made))
    return made


def flat(spec: SwarmSpec, cluster: Cluster) -> list[Object]:
    """All objects but the secrets."""
    return [one for own in kubernetes.objects(spec, cluster).values() for one in own]


def workloads(objects: list[Object]) -> dict[str, Object]:
    """What makes pods, by name."""
    return {one["metadata"]["name"]: one for one in objects if "template" in one.get("spec", {})}


def selectors(objects: list[Object]) -> Iterator[tuple[str, dict[str, str], str]]:
    """(whose, the labels that are wanted, of which kind) of all objects."""
    for one in objects:
        name, spec = f"{one['kind']} {one['metadata']['name']}", one["spec"]
        match one["kind"]:
            case "Service":
                yield name, spec["selector"], "pod"
            case "ServiceMonitor":
                yield name, spec["selector"]["matchLabels"], "Service"
            case "NetworkPolicy":
                yield name, spec["podSelector"]["matchLabels"], "pod"
                for rule in spec["ingress"]:
                    for source in rule["from"]:
                        if "podSelector" in source:
                            yield name, source["podSelector"]["matchLabels"], "pod"
            case "PrometheusRule":
                pass
            case _:
                yield name, spec["selector"]["matchLabels"], "pod"


def rendered(files: dict[str, str], **values: str) -> list[Object]:
    """A chart's objects, as Helm makes them; values that are not given are the chart's own."""
    known = yaml.safe_load(files["values.yaml"]) | values
    found: list[Object] = []

    def put(action: re.Match[str]) -> str:
        word = action[1].strip()
        if word == '"{{"':
            return "{{"
        assert word.startswith(".Values."), f"{action[0]} is neither of the two known forms"
        return str(known[word.removeprefix(".Values.")])

    for name, text in files.items():
        if name.startswith("templates/"):
            found += yaml.safe_load_all(re.sub(r"\{\{(.*?)\}\}", put, text))
    return found


@pytest.mark.parametrize("version", [OLDEST, NEWEST])
def test_every_object_is_as_the_published_schemas_have_it(
    spec: SwarmSpec, cluster: Cluster, version: str
) -> None:
    objects = [*flat(spec, cluster), *kubernetes.secrets(spec, cluster)]
    own = [one for one in objects if not one["apiVersion"].startswith(FOREIGN)]
    assert {one["kind"] for one in objects} - {one["kind"] for one in own} == {
        *("ServiceMonitor", "PrometheusRule")
    }
    for one in own:
        used = kubernetes_validate.validate(one, version, strict=True)
        assert used == version, "the schemas are of that very version"


def test_in_a_mesh_each_robot_goes_to_the_router_of_its_node(spec: SwarmSpec) -> None:
    cluster = replace(HOST, llm_image="l:1", hosts=kubernetes.own_routers(spec))
    keep(
        spec,
        plan.place_of(spec, cluster),
        plan.roles(spec, cluster),
        plan.router_addresses(cluster),
    )
    objects = flat(spec, cluster)
    pods = {name: one["spec"]["template"]["spec"] for name, one in workloads(objects).items()}
    services = {one["metadata"]["name"] for one in objects if one["kind"] == "Service"}
    for robot in ("r1", "arm-2", "r3"):
        own = f"router-{robot}"
        assert own in services
        assert pods[own]["nodeSelector"] == pods[f"robot-{robot}"]["nodeSelector"]
        (container,) = pods[f"robot-{robot}"]["containers"]
        env = {one["name"]: one.get("value") for one in container["env"]}
        assert env["COADAPT_ROUTER"].startswith(f"tls/{own}:7447#")
    (container,) = pods["router-r3"]["containers"]
    peers = [after for word, after in pairwise(container["command"]) if word == "--peer"]
    assert peers == [f"tls/{name}:7447" for name in ("router", "router-r1", "router-arm-2")]


def test_the_schemas_refuse_what_is_not_theirs(spec: SwarmSpec, cluster: Cluster) -> None:
    pod = workloads(flat(spec, cluster))["robot-r1"]
    pod["spec"]["template"]["spec"]["containers"][0]["enviroment"] = []
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(pod, NEWEST, strict=True)


def test_every_selector_finds_what_it_is_meant_for(spec: SwarmSpec, cluster: Cluster) -> None:
    objects = flat(spec, cluster)
    pods = {n: w["spec"]["template"]["metadata"]["labels"] for n, w in workloads(objects).items()}
    services = {
        one["metadata"]["name"]: one["metadata"]["labels"]
        for one in objects
        if one["kind"] == "Service"
    }
    for whose, wanted, kind in selectors(objects):
        things = services if kind == "Service" else pods
        found = [name for name, labels in things.items() if wanted.items() <= labels.items()]
        if whose.split()[0] in ("Deployment", "StatefulSet", "DaemonSet"):
            assert found == [whose.split()[1]], "each selects its own pods, and no other's"
        elif whose.startswith("Service router"):
            assert found == [whose.split()[1]]
        elif whose == "PodDisruptionBudget robots":
            assert sorted(found) == ["robot-arm-2", "robot-r1", "robot-r3"]
        elif kind == "Service":
            assert found == ["metrics"]
        else:
            assert set(found) == set(pods), whose


def test_every_port_that_is_named_is_there(spec: SwarmSpec, cluster: Cluster) -> None:
    objects = flat(spec, cluster)
    for name, one in workloads(objects).items():
        (container,) = one["spec"]["template"]["spec"]["containers"]
        named = {port["name"]: port["containerPort"] for port in container["ports"]}
        assert len(set(named.values())) == len(named), name
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            assert container[probe]["httpGet"]["port"] in named, name
        env = {pair["name"]: pair.get("value", "") for pair in container["env"]}
        assert env.get("COADAPT_METRICS_PORT", "9100") == str(named["metrics"]), name
    by_name = {one["metadata"]["name"]: one for one in objects if one["kind"] == "Service"}
    assert {port["port"] for port in by_name["router"]["spec"]["ports"]} == {7447, 7448, 7449}
    assert [port["targetPort"] for port in by_name["metrics"]["spec"]["ports"]] == ["metrics"]


def test_every_secret_and_volume_is_there_and_nobody_has_anothers(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    secrets = {one["metadata"]["name"]: one for one in kubernetes.secrets(spec, cluster)}
    used: dict[str, str] = {}
    for name, one in workloads(flat(spec, cluster)).items():
        pod = one["spec"]["template"]["spec"]
        volumes = {volume["name"]: volume for volume in pod["volumes"]}
        mounted = {mount["name"] for mount in pod["containers"][0]["volumeMounts"]}
        assert mounted == set(volumes), name
        for volume in volumes.values():
            if "secret" in volume:
                assert used.setdefault(volume["secret"]["secretName"], name) == name
    assert set(used) == set(secrets)
    assert set(secrets["identity-ego-r1"]["data"]) == {"ca.pem", "cert.pem", "key.pem"}
    assert set(secrets["identity-router"]["data"]) == {"ca.pem", "cert.pem", "key.pem", "members"}
    assert set(secrets["settings-console"]["data"]) == {"coadapt_console_token"}


def test_an_identity_lies_where_its_process_looks_for_it(spec: SwarmSpec, cluster: Cluster) -> None:
    found = workloads(flat(spec, cluster))
    for name, own in {"robot-arm-2": "arm_2", "ego-r1": "ego-R1", "console": "console"}.items():
        (container,) = found[name]["spec"]["template"]["spec"]["containers"]
        env = {pair["name"]: pair.get("value", "") for pair in container["env"]}
        router, identity = env["COADAPT_ROUTER"].split("#identity=")
        robot = {"robot-arm-2": "arm_2", "ego-r1": "R1"}.get(name, "")
        assert router == f"tls/{cluster.hosts.get(robot, 'router')}:7447"
        assert Path(identity).name == own
        assert identity in {mount["mountPath"] for mount in container["volumeMounts"]}


def test_a_process_may_do_no_more_than_its_part(spec: SwarmSpec, cluster: Cluster) -> None:
    for name, one in workloads(flat(spec, cluster)).items():
        pod = one["spec"]["template"]["spec"]
        shapes = name.startswith("controller-")
        assert pod["securityContext"]["runAsNonRoot"] != shapes, name
        assert pod["automountServiceAccountToken"] is False, name
        (container,) = pod["containers"]
        context = container["securityContext"]
        added = {"add": ["NET_ADMIN", "DAC_OVERRIDE"]} if shapes else {}
        assert context["capabilities"] == {"drop": ["ALL"], **added}, name
        assert context["readOnlyRootFilesystem"], name
        assert not context["allowPrivilegeEscalation"], name
        assert int(container["resources"]["limits"]["memory"]) >= 256 << 20, name


def test_a_robot_is_one_pod_on_its_own_node_however_long_the_node_is_away(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    found = workloads(flat(spec, cluster))
    for name, robot in {"robot-r1": "R1", "robot-arm-2": "arm_2", "ego-arm-2": "arm_2"}.items():
        pod = found[name]["spec"]["template"]["spec"]
        assert found[name]["spec"]["replicas"] == 1
        assert pod["nodeSelector"] == {"coadapt/robot": robot}
        stays = {one["key"] for one in pod["tolerations"] if "tolerationSeconds" not in one}
        assert stays == {"node.kubernetes.io/not-ready", "node.kubernetes.io/unreachable"}
        assert pod.get("hostNetwork", False) == (cluster.network == "host")
    # Neither starts a pod before the one before it is known to have ended.
    assert {found[f"robot-{one}"]["kind"] for one in ("r1", "arm-2", "r3")} == {"StatefulSet"}
    for name, one in found.items():
        if one["kind"] == "Deployment":
            assert one["spec"]["strategy"] == {"type": "Recreate"}, name


def test_each_robots_node_has_a_controller_where_an_interface_is_named(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    found = {
        name: one["spec"]["template"]["spec"]
        for name, one in workloads(flat(spec, cluster)).items()
        if one["kind"] == "DaemonSet"
    }
    robots = {f"controller-{kubernetes.name_of(robot)}": robot for robot in ROBOTS}
    assert set(found) == (set(robots) if cluster.interface else set())
    for name, pod in found.items():
        assert pod["nodeSelector"] == {"coadapt/robot": robots[name]}
        assert pod["hostNetwork"]


def test_names_that_kubernetes_cannot_tell_apart_are_refused(tmp_path: Path) -> None:
    spec = make_spec(robots=("r1", "R1"), runtime="kubernetes", var_dir=str(tmp_path))
    with pytest.raises(DeployError, match="robot-r1 and robot-R1 have one name in Kubernetes"):
        kubernetes.objects(spec, HOST)


def test_the_chart_is_the_same_objects_with_values_to_choose(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    files = charts.chart(spec, cluster, site.MONITORING, "1.2.3")
    key = lambda one: (one["kind"], one["metadata"]["name"])  # noqa: E731
    assert sorted(rendered(files), key=key) == sorted(flat(spec, cluster), key=key)
    about = yaml.safe_load(files["Chart.yaml"])
    assert (about["apiVersion"], about["name"], about["appVersion"]) == (
        *("v2", "coadapt-edge", "1.2.3"),
    )
    chosen = rendered(files, image="other/edge:2@sha256:" + "1" * 64, monitoringNamespace="watch")
    images = {
        one["spec"]["template"]["spec"]["containers"][0]["image"]
        for name, one in workloads(chosen).items()
        if name != "gateway"
    }
    assert images == {"other/edge:2@sha256:" + "1" * 64}
    (policy,) = [one for one in chosen if one["kind"] == "NetworkPolicy"]
    assert {"kubernetes.io/metadata.name": "watch"} in [
        source["namespaceSelector"]["matchLabels"]
        for rule in policy["spec"]["ingress"]
        for source in rule["from"]
        if "namespaceSelector" in source
    ]


def test_kustomize_builds_the_base(spec: SwarmSpec, cluster: Cluster, tmp_path: Path) -> None:
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl, which has kustomize built in, is not installed")
    base, chart = charts.write(tmp_path / "out", spec, cluster, site.MONITORING, "1.2.3")
    assert (chart / "Chart.yaml").is_file()
    done = subprocess.run(
        ["kubectl", "kustomize", str(base)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    key = lambda one: (one["kind"], one["metadata"]["name"])  # noqa: E731
    built = sorted(yaml.safe_load_all(done.stdout), key=key)
    assert built == sorted(flat(spec, cluster), key=key)


def test_prometheus_operator_is_told_the_labels_that_dashboards_ask_for(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    (monitor,) = [one for one in flat(spec, cluster) if one["kind"] == "ServiceMonitor"]
    (endpoint,) = monitor["spec"]["endpoints"]
    assert endpoint["port"] == "metrics"
    assert endpoint["honorLabels"]
    told = {rule["sourceLabels"][0]: rule["targetLabel"] for rule in endpoint["relabelings"]}
    assert told == {
        "__meta_kubernetes_pod_label_app_kubernetes_io_component": "role",
        "__meta_kubernetes_pod_label_coadapt_process": "instance",
        "__meta_kubernetes_pod_label_coadapt_robot": "robot",
    }
    (rules,) = [one for one in flat(spec, cluster) if one["kind"] == "PrometheusRule"]
    assert {alert["alert"] for g in rules["spec"]["groups"] for alert in g["rules"]} >= {"EgoBlind"}


def test_metrics_over_tls_are_asked_for_so(spec: SwarmSpec, cluster: Cluster) -> None:
    over_tls = msgspec.structs.replace(spec, metrics_tls=True)
    objects = flat(over_tls, cluster)
    for one in workloads(objects).values():
        (container,) = one["spec"]["template"]["spec"]["containers"]
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            assert container[probe]["httpGet"]["scheme"] == "HTTPS"
        assert {"name": "COADAPT_METRICS_TLS", "value": "true"} in container["env"] or (
            "--metrics-tls" in container["command"]
        )
    (monitor,) = [one for one in objects if one["kind"] == "ServiceMonitor"]
    (endpoint,) = monitor["spec"]["endpoints"]
    assert endpoint["scheme"] == "https"
    held = endpoint["tlsConfig"]["ca"]["secret"]
    secrets = {one["metadata"]["name"]: one for one in kubernetes.secrets(over_tls, cluster)}
    assert held["key"] in secrets[held["name"]]["data"]


def test_where_nobody_looks_no_namespace_may_read_metrics(
    spec: SwarmSpec, cluster: Cluster
) -> None:
    files = kubernetes.objects(spec, cluster, "")
    assert "monitoring.yaml" not in files
    (policy,) = files["network-policy.yaml"]
    assert not any("namespaceSelector" in s for r in policy["spec"]["ingress"] for s in r["from"])
    assert "monitoringNamespace" not in charts.chart(spec, cluster, "", "1.2.3")["values.yaml"]


def test_a_service_account_is_nobodys_and_recorded_data_is_only_read(
    tmp_path: Path, spec: SwarmSpec, cluster: Cluster
) -> None:
    pod = workloads(flat(spec, cluster))["robot-r1"]["spec"]["template"]["spec"]
    data = [one for one in pod["volumes"] if "hostPath" in one]
    assert [one["hostPath"] for one in data] == [{"path": spec.data, "type": "Directory"}]
    mounts = pod["containers"][0]["volumeMounts"]
    (mount,) = [one for one in mounts if one["name"] == data[0]["name"]]
    assert (mount["mountPath"], mount["readOnly"]) == (compose.DATA, True)
