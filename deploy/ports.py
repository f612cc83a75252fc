"""Ports of the host's 127.0.0.1 that a swarm answers on: taken before anything is started."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Literal

from deploy.spec import SwarmSpec
from swarm.errors import DeployError
from swarm.traffic import LINKS

LOCALHOST = "127.0.0.1"
_BACKLOG = 64


def listen(port: int, what: str) -> socket.socket:
    """A listening socket on 127.0.0.1. Raises DeployError that says for what the port is."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # A port whose last connections linger in TIME_WAIT is free.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOCALHOST, port))
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise DeployError(
            f"port {port} on {LOCALHOST}, for {what}, cannot be taken: {error.strerror}; "
            "free it or choose another one"
        ) from error
    return listener


Endpoint = Literal["ego metrics", "prometheus", "qod", "llm", "grafana", "console"]


@contextlib.contextmanager
def listen_endpoints(spec: SwarmSpec) -> Iterator[dict[Endpoint, socket.socket]]:
    """Listening sockets for what people on the host reach of a swarm, closed at the end.

    Raises DeployError when a port is taken; none is held then.
    """
    with contextlib.ExitStack() as stack:
        endpoints: dict[Endpoint, socket.socket] = {}
        for endpoint, port, what in _endpoints(spec):
            endpoints[endpoint] = stack.enter_context(listen(port, what))
        yield endpoints


def _endpoints(spec: SwarmSpec) -> Iterator[tuple[Endpoint, int, str]]:
    yield "ego metrics", spec.ego_metrics_port, "the ego's metrics (--ego-metrics-port)"
    yield "qod", spec.qod_port, "the Quality-on-Demand API (--qod-port)"
    if spec.llm:
        yield "llm", spec.llm_port, "the LLM gateway's HTTP endpoint (--llm-port)"
    if spec.prometheus:
        yield "prometheus", spec.prometheus_port, "Prometheus (--prometheus-port)"
    if spec.grafana:
        yield "grafana", spec.grafana_port, "Grafana (--grafana-port)"
    if spec.console:
        yield "console", spec.console_port, "the console (--console-port)"


def check_free(spec: SwarmSpec) -> None:
    """Raises DeployError when a port that a container runtime publishes is taken."""
    with listen_endpoints(spec):
        for port in range(spec.router_port, spec.router_port + LINKS):
            listen(port, "the router (--router-port)").close()
