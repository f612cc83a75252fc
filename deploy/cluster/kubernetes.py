"""A swarm as objects of Kubernetes: one for each thing that the API has a word for."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath

from deploy.cluster import plan, site
from deploy.cluster.plan import Cluster, Container
from deploy.cluster.site import Object
from deploy.docker import compose
from deploy.spec import SwarmSpec
from swarm.errors import DeployError

_ON_HOSTS = ("router", "robot", "ego", "controller")
"""Whose packets keep their marks in the nodes' own network; the others have an address of the
cluster's, where its rules for networks hold."""
_STAYS: Sequence[Object] = [
    # A node that the control plane does not hear goes on with what it has.
    {"key": f"node.kubernetes.io/{trouble}", "operator": "Exists", "effect": "NoExecute"}
    for trouble in ("not-ready", "unreachable")
]
_KEPT: Mapping[str, Object] = {
    "StatefulSet": {"replicas": 1, "serviceName": site.METRICS},
    "Deployment": {"replicas": 1, "strategy": {"type": "Recreate"}},
    "DaemonSet": {},
}
_CPU: Mapping[str, str] = {"ego": "1", "robot": "200m"}
"""What a process is sure to get; others 50m."""


def objects(
    spec: SwarmSpec, cluster: Cluster, monitoring: str = site.MONITORING
) -> dict[str, list[Object]]:
    """All objects but the secrets, by the file in which they belong. They name no namespace: a
    swarm has one of its own. `monitoring`: the namespace from which Prometheus comes; empty: nobody
    is to look.

    Raises DeployError for what Kubernetes cannot have.
    """
    wanted = plan.containers(spec, cluster)
    _check_names(one.service.name for one in wanted)
    by_role: dict[str, list[Container]] = {}
    for one in wanted:
        by_role.setdefault(one.service.role, []).append(one)
    robots = [_workload(spec, cluster, one, "StatefulSet") for one in by_role.pop("robot")]
    files = {
        "services.yaml": [
            *(
                site.router_service(spec, name_of(one.service.name), one.service.name)
                for one in by_role["router"]
            ),
            site.metrics_service(spec),
        ],
        "robots.yaml": [*robots, site.disruption_budget(spec)],
        **{
            f"{role}.yaml": [
                _workload(spec, cluster, one, "DaemonSet" if role == "controller" else "Deployment")
                for one in own
            ]
            for role, own in by_role.items()
        },
        "network-policy.yaml": [site.network_policy(spec, monitoring)],
    }
    if monitoring:
        files["monitoring.yaml"] = [site.service_monitor(spec), site.alerts(spec)]
    return files


def secrets(spec: SwarmSpec, cluster: Cluster) -> list[Object]:
    """The Secrets that `objects` refers to, with certificates and keys in them. Raises DeployError
    for a file that cannot be read."""
    made: dict[str, Object] = {}
    for one in plan.containers(spec, cluster):
        for name, folder in _secret_names(one).items():
            own = {p: f for p, f in one.files.items() if str(PurePosixPath(p).parent) == folder}
            try:
                data = {
                    PurePosixPath(place).name: base64.b64encode(file.read_bytes()).decode()
                    for place, file in own.items()
                }
            except OSError as error:
                raise DeployError(f"{error.filename}: {error.strerror}") from error
            made[name] = {
                "apiVersion": "v1",
                "kind": "Secret",
                "metadata": {"name": name, "labels": site.labels_of(spec)},
                "type": "Opaque",
                "data": data,
            }
    return list(made.values())


def own_routers(spec: SwarmSpec) -> dict[str, str]:
    """The Service of the router that each robot's node has, where each has one."""
    return {robot: name_of(f"router-{robot}") for robot in spec.robots}


def name_of(text: str) -> str:
    """A name as Kubernetes allows it.

    >>> name_of("ego-R1"), name_of("arm_7")
    ('ego-r1', 'arm-7')
    """
    return re.sub(r"[^a-z0-9-]", "-", text.lower()).strip("-")


def _check_names(names: Iterable[str]) -> None:
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(name_of(name), name)
        if other != name:
            raise DeployError(f"{other} and {name} have one name in Kubernetes, {name_of(name)}")


def _workload(spec: SwarmSpec, cluster: Cluster, one: Container, kind: str) -> Object:
    """What keeps one process running, and one only: neither a StatefulSet nor a Deployment that
    recreates begins a pod before the last one is known to have ended."""
    labels = {
        **site.labels_of(spec),
        site.COMPONENT: one.service.role,
        site.PROCESS_LABEL: one.service.name,
        **({site.ROBOT_LABEL: one.robot} if one.robot else {}),
    }
    return {
        "apiVersion": "apps/v1",
        "kind": kind,
        "metadata": {"name": name_of(one.service.name), "labels": labels},
        "spec": {
            "selector": {
                "matchLabels": {**site.labels_of(spec), site.PROCESS_LABEL: one.service.name}
            },
            **_KEPT[kind],
            "template": {"metadata": {"labels": labels}, "spec": _pod(cluster, one)},
        },
    }


def _pod(cluster: Cluster, one: Container) -> Object:
    on_host = cluster.network == "host" and one.service.role in _ON_HOSTS
    if one.robot:
        where = {site.ROBOT_LABEL: one.robot}
    else:
        where = {site.SITE_LABEL: "true"} if one.service.role == "router" else {}
    return {
        **({"nodeSelector": where, "tolerations": list(_STAYS)} if where else {}),
        **({"hostNetwork": True, "dnsPolicy": "ClusterFirstWithHostNet"} if on_host else {}),
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "terminationGracePeriodSeconds": plan.ENDS_S,
        "securityContext": {
            "runAsNonRoot": one.user != 0,
            "runAsUser": one.user,
            "runAsGroup": one.user,
            "fsGroup": one.user,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "containers": [_container(one)],
        "volumes": _volumes(one),
    }


def _container(one: Container) -> Object:
    container: Object = {
        "name": one.service.role,
        "image": one.image,
        "command": list(one.service.argv),
        "env": [
            *({"name": name, "value": value} for name, value in one.env.items()),
            {"name": "COADAPT_HOST", "valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}},
        ],
        "resources": {
            "requests": {"cpu": _CPU.get(one.service.role, "50m"), "memory": str(one.memory // 4)},
            "limits": {"memory": str(one.memory)},
        },
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]}
            | ({"add": list(one.capabilities)} if one.capabilities else {}),
        },
        "volumeMounts": _mounts(one),
    }
    ports = [{"name": f"port-{port}", "containerPort": port} for port in one.ports]
    if one.service.metrics_port is not None:
        ports.append({"name": site.METRICS, "containerPort": one.service.metrics_port})
        scheme = {"scheme": "HTTPS"} if one.tls else {}
        asked = {"httpGet": {"path": "/metrics", "port": site.METRICS, **scheme}}
        often = {
            "periodSeconds": plan.HEALTH_PERIOD_S,
            "timeoutSeconds": plan.HEALTH_TIMEOUT_S,
            "failureThreshold": plan.HEALTH_RETRIES,
        }
        begins = plan.HEALTH_START_S // plan.HEALTH_PERIOD_S
        container["startupProbe"] = {**asked, **often, "failureThreshold": begins}
        container["livenessProbe"] = container["readinessProbe"] = {**asked, **often}
    return container | ({"ports": ports} if ports else {})


def _mounts(one: Container) -> list[Object]:
    found: list[Object] = [{"name": "tmp", "mountPath": "/tmp"}]
    found += [
        {"name": name, "mountPath": folder, "readOnly": True}
        for name, folder in _secret_names(one).items()
    ]
    for folder in one.folders:
        found.append({"name": folder, "mountPath": f"{compose.PLACE.var_dir}/{folder}"})
    if one.data:
        found.append({"name": "data", "mountPath": compose.DATA, "readOnly": True})
    return found


def _volumes(one: Container) -> list[Object]:
    found: list[Object] = [
        {"name": "tmp", "emptyDir": {"medium": "Memory", "sizeLimit": str(plan.TMP_BYTES)}}
    ]
    found += [
        {"name": name, "secret": {"secretName": name, "defaultMode": 0o440}}
        for name in _secret_names(one)
    ]
    found += [{"name": folder, "emptyDir": {}} for folder in one.folders]
    if one.data:
        found.append({"name": "data", "hostPath": {"path": one.data, "type": "Directory"}})
    return found


def _secret_names(one: Container) -> dict[str, str]:
    """The Secrets of a container, and the folder in which each appears."""
    found = {}
    for folder in dict.fromkeys(str(PurePosixPath(place).parent) for place in one.files):
        own = one.common_name and PurePosixPath(folder).name == one.common_name
        what = f"identity-{one.common_name}" if own else f"settings-{one.service.name}"
        found[name_of(what)] = folder
    return found
