"""What stands around a swarm's pods in Kubernetes: names, who may reach them, who looks at them."""

from __future__ import annotations

import re
from typing import Any

import yaml

from deploy.dashboards import ALERTS
from deploy.scraping import SCRAPE_S
from deploy.spec import SwarmSpec
from swarm.trust.identity import CA
from swarm.trust.serving import SERVER_NAME

Object = dict[str, Any]

ROUTER = "router"
"""The router's Service, by whose name all reach it."""
METRICS = "metrics"
"""The Service, and the port of each container, where Prometheus finds metrics."""
ROBOT_LABEL, SITE_LABEL = "coadapt/robot", "coadapt/site"
"""Of a node: the robot that it is, and whether it runs the router."""
PROCESS_LABEL = "coadapt/process"
"""Of a pod: the process's name, by which exactly its own objects select it."""
COMPONENT = "app.kubernetes.io/component"
_TLS: Object = {
    "scheme": "https",
    "tlsConfig": {
        # The authority's certificate, which every identity has.
        "ca": {"secret": {"name": "identity-router", "key": CA}},
        "serverName": SERVER_NAME,
    },
}
MONITORING = "monitoring"
"""The namespace from which Prometheus comes."""


def labels_of(spec: SwarmSpec) -> dict[str, str]:
    """By which a swarm's objects are told from others."""
    return {"app.kubernetes.io/name": "coadapt-edge", "app.kubernetes.io/instance": spec.swarm}


def router_service(spec: SwarmSpec, name: str, process: str) -> Object:
    """The name of a router's process. Without an address of its own: it leads to the router's node
    or pod itself."""
    ports = range(spec.router_port, spec.router_port + 3)
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": name, "labels": labels_of(spec)},
        "spec": {
            "clusterIP": "None",
            "publishNotReadyAddresses": True,
            "selector": {**labels_of(spec), PROCESS_LABEL: process},
            "ports": [{"name": f"port-{port}", "port": port} for port in ports],
        },
    }


def metrics_service(spec: SwarmSpec) -> Object:
    """Behind which Prometheus' operator finds all pods."""
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": METRICS, "labels": {**labels_of(spec), COMPONENT: METRICS}},
        "spec": {
            "clusterIP": "None",
            "publishNotReadyAddresses": True,
            "selector": labels_of(spec),
            # Each pod's own number behind the one name.
            "ports": [{"name": METRICS, "port": 9100, "targetPort": METRICS}],
        },
    }


def disruption_budget(spec: SwarmSpec) -> Object:
    """Who empties nodes for maintenance takes one robot at a time."""
    return {
        "apiVersion": "policy/v1",
        "kind": "PodDisruptionBudget",
        "metadata": {"name": "robots", "labels": labels_of(spec)},
        "spec": {
            "maxUnavailable": 1,
            "selector": {"matchLabels": {**labels_of(spec), COMPONENT: "robot"}},
        },
    }


def network_policy(spec: SwarmSpec, monitoring: str) -> Object:
    """Who may reach the pods: the swarm's own, and Prometheus their metrics."""
    prometheus = {"matchLabels": {"kubernetes.io/metadata.name": monitoring}}
    metrics = {"from": [{"namespaceSelector": prometheus}], "ports": [{"port": METRICS}]}
    return {
        "apiVersion": "networking.k8s.io/v1",
        "kind": "NetworkPolicy",
        "metadata": {"name": "swarm", "labels": labels_of(spec)},
        "spec": {
            "podSelector": {"matchLabels": labels_of(spec)},
            "policyTypes": ["Ingress"],
            "ingress": [
                {"from": [{"podSelector": {"matchLabels": labels_of(spec)}}]},
                *([metrics] if monitoring else []),
            ],
        },
    }


def service_monitor(spec: SwarmSpec) -> Object:
    """Tells Prometheus' operator what to scrape, with the labels that dashboards and alerts ask
    for."""
    named = {COMPONENT: "role", PROCESS_LABEL: "instance", ROBOT_LABEL: "robot"}
    return {
        "apiVersion": "monitoring.coreos.com/v1",
        "kind": "ServiceMonitor",
        "metadata": {"name": "swarm", "labels": labels_of(spec)},
        "spec": {
            "selector": {"matchLabels": {**labels_of(spec), COMPONENT: METRICS}},
            "endpoints": [
                {
                    "port": METRICS,
                    **(_TLS if spec.metrics_tls else {}),
                    "interval": f"{SCRAPE_S}s",
                    "scrapeTimeout": f"{SCRAPE_S}s",
                    # A robot process and the ego name robots in their own metrics.
                    "honorLabels": True,
                    "relabelings": [
                        {
                            "sourceLabels": [
                                "__meta_kubernetes_pod_label_" + re.sub(r"\W", "_", label)
                            ],
                            "targetLabel": target,
                        }
                        for label, target in named.items()
                    ],
                }
            ],
        },
    }


def alerts(spec: SwarmSpec) -> Object:
    """The alert rules, for Prometheus' operator."""
    return {
        "apiVersion": "monitoring.coreos.com/v1",
        "kind": "PrometheusRule",
        "metadata": {"name": "swarm", "labels": labels_of(spec)},
        "spec": yaml.safe_load(ALERTS.read_text()),
    }
