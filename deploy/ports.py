"""Ports of the host's 127.0.0.1 that a swarm answers on: taken before anything is started."""

from __future__ import annotations

import socket

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


def listen_metrics(spec: SwarmSpec) -> tuple[socket.socket, socket.socket | None]:
    """Listening sockets for the ego's metrics and, if the swarm has one, for Prometheus.

    Raises DeployError when either is taken; none is held then.
    """
    ego = listen(spec.ego_metrics_port, "the ego's metrics (--ego-metrics-port)")
    if not spec.prometheus:
        return ego, None
    try:
        return ego, listen(spec.prometheus_port, "Prometheus (--prometheus-port)")
    except DeployError:
        ego.close()
        raise


def check_free(spec: SwarmSpec) -> None:
    """Raises DeployError when a port that a container runtime publishes is taken."""
    for listener in listen_metrics(spec):
        if listener is not None:
            listener.close()
    for port in range(spec.router_port, spec.router_port + LINKS):
        listen(port, "the router (--router-port)").close()
