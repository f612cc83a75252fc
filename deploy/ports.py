"""Ports of the host on which a swarm answers: chosen, and taken before anything is started."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Collection, Iterator
from typing import Literal

import msgspec

from deploy.spec import PORT_FIELDS, SwarmSpec
from swarm.errors import DeployError
from swarm.traffic import LINKS

LOCALHOST = "127.0.0.1"
ANYWHERE = ""
_BACKLOG = 64
_SEARCHED = 500
"""So many ports above a taken one are tried."""
_LAST = 65532
"""The last that may be the first of several."""

Endpoint = Literal[
    "ego metrics", "prometheus", "qod", "llm", "grafana", "console",
    "router control", "router fusion", "router background",
]  # fmt: skip
ROUTER: tuple[Endpoint, ...] = ("router control", "router fusion", "router background")
"""Of each traffic class, in their order."""


class PortUse(msgspec.Struct, frozen=True):
    """What a swarm uses a port of the host for."""

    what: str
    """For messages: "the console"."""
    field: str
    """The specification's property."""
    host: str = LOCALHOST
    """Where it must be free; ANYWHERE where the address is known only when it starts."""
    count: int = 1
    """Of ports that follow one another."""
    endpoints: tuple[Endpoint, ...] = ()
    """Which of what is reached from outside of the swarm's network they are, each with a port."""


def ports_of(spec: SwarmSpec) -> Iterator[PortUse]:
    """All that a swarm needs of the host, in the runtime in which it is to run."""
    yield PortUse("the ego's metrics", "ego_metrics_port", endpoints=("ego metrics",))
    yield PortUse("the Quality-on-Demand API", "qod_port", endpoints=("qod",))
    if spec.llm:
        yield PortUse("the LLM gateway's HTTP endpoint", "llm_port", endpoints=("llm",))
    if spec.prometheus:
        yield PortUse("Prometheus", "prometheus_port", endpoints=("prometheus",))
    if spec.grafana:
        yield PortUse("Grafana", "grafana_port", endpoints=("grafana",))
    if spec.console:
        yield PortUse("the console", "console_port", endpoints=("console",))
    if spec.runtime != "docker":
        if spec.listen:
            yield PortUse("the router", "router_port", spec.listen, LINKS, ROUTER)
        return  # What follows lies inside of the swarm's namespaces.
    # It answers on the host's loopback in any case.
    host = ANYWHERE if spec.listen not in ("", LOCALHOST) else LOCALHOST
    yield PortUse("the router", "router_port", host, LINKS)
    yield PortUse("the network controller's metrics", "controller_metrics_port", ANYWHERE)
    if spec.llm:
        yield PortUse("the LLM gateway's metrics", "gateway_metrics_port", ANYWHERE)
    if spec.console:
        yield PortUse("the console's metrics", "console_metrics_port", ANYWHERE)


def with_free_ports(spec: SwarmSpec, named: Collection[str]) -> tuple[SwarmSpec, list[str]]:
    """The same swarm on the next free ports where its own are taken, and what was changed, in
    words. `named`: properties that stay as they are, as somebody has asked for them.

    Raises DeployError where no port is free.
    """
    uses = list(ports_of(spec))
    held = {port for use in uses if use.field in named for port in _range(spec, use)}
    changes: dict[str, int] = {}
    notes = []
    for use in uses:
        if use.field in named:
            continue
        wanted = int(getattr(spec, use.field))
        port = _next_free(use, wanted, held)
        held.update(range(port, port + use.count))
        if port != wanted:
            changes[use.field] = port
            notes.append(f"{use.what}: port {port}, as {wanted} is taken")
    return msgspec.structs.replace(spec, **changes), notes


def based_on(base: int) -> dict[str, int]:
    """All ports of a swarm from one on, by property. Raises DeployError where they do not fit."""
    # The router's are several: they come last.
    fields = sorted(PORT_FIELDS, key=lambda name: name == "router_port")
    highest = _LAST - len(fields) + 1
    if not 1 <= base <= highest:
        raise DeployError(
            f"--port-base {base} is not valid; it must be 1 to {highest}, as a swarm takes the "
            f"{len(fields) + LINKS - 1} ports from there on"
        )
    return {name: base + i for i, name in enumerate(fields)}


def listen(port: int, what: str, host: str = LOCALHOST) -> socket.socket:
    """A listening socket. Raises DeployError that says for what the port is."""
    try:
        return _listening(port, host)
    except OSError as error:
        raise DeployError(
            f"port {port}{f' on {host}' if host else ''}, for {what}, cannot be taken: "
            f"{error.strerror}; free it or choose another one"
        ) from error


@contextlib.contextmanager
def listen_endpoints(spec: SwarmSpec) -> Iterator[dict[Endpoint, socket.socket]]:
    """Listening sockets for what is reached of a swarm from outside, closed at the end.

    Raises DeployError when a port is taken; none is held then.
    """
    with contextlib.ExitStack() as stack:
        endpoints: dict[Endpoint, socket.socket] = {}
        for use in ports_of(spec):
            for port, endpoint in zip(_range(spec, use), use.endpoints, strict=False):
                listener = stack.enter_context(listen(port, _words(use), use.host))
                endpoints[endpoint] = listener
        yield endpoints


def check_free(spec: SwarmSpec) -> None:
    """Raises DeployError when a port that a container runtime publishes is taken."""
    with contextlib.ExitStack() as stack:
        for use in ports_of(spec):
            for port in _range(spec, use):
                stack.enter_context(listen(port, _words(use), use.host))


def _words(use: PortUse) -> str:
    return f"{use.what} (--{use.field.replace('_', '-')})"


def _range(spec: SwarmSpec, use: PortUse) -> range:
    first = int(getattr(spec, use.field))
    return range(first, first + use.count)


def _next_free(use: PortUse, wanted: int, held: Collection[int]) -> int:
    last = min(wanted + _SEARCHED, _LAST)
    for first in range(wanted, last + 1):
        ports = range(first, first + use.count)
        if not any(port in held for port in ports) and all(_free(p, use.host) for p in ports):
            return first
    raise DeployError(f"no port from {wanted} to {last} is free for {_words(use)}")


def _free(port: int, host: str) -> bool:
    try:
        _listening(port, host).close()
    except OSError:
        return False
    return True


def _listening(port: int, host: str) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # A port whose last connections linger in TIME_WAIT is free.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(_BACKLOG)
    except OSError:
        listener.close()
        raise
    return listener
