"""What a router's connections of the fusion class have carried, by the host at the other end."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from prometheus_client.core import CounterMetricFamily, Metric
from prometheus_client.registry import Collector

from swarm.messages import Backlog

MAX_PEERS = 256
"""Hosts that are told apart; what goes to more of them is counted as `others`."""


@dataclass(slots=True)
class _Host:
    sent_bytes: int = 0
    stood_ms: int = 0


class PeerTraffic(Collector):
    """Counters that only grow, also where connections come and go."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._hosts: dict[str, _Host] = {}
        self._before: Mapping[str, Backlog] = {}

    def take(self, seen: Mapping[str, Backlog]) -> None:
        """Takes in the connections of this moment, by the other end's address and port."""
        with self._lock:
            for peer, now in seen.items():
                before = self._before.get(peer, Backlog())
                if now.sent_bytes < before.sent_bytes:
                    before = Backlog()  # Another connection from the same port.
                name = peer.rpartition(":")[0].strip("[]")
                if name not in self._hosts and len(self._hosts) >= MAX_PEERS:
                    name = "others"
                host = self._hosts.setdefault(name, _Host())
                host.sent_bytes += now.sent_bytes - before.sent_bytes
                host.stood_ms += max(0, now.stood_ms - before.stood_ms)
            self._before = dict(seen)

    def collect(self) -> Iterator[Metric]:
        """See `Collector.collect`."""
        sent = CounterMetricFamily(
            "coadapt_router_peer_sent_bytes",
            "Bytes of the fusion class that the router has sent to a host.",
            labels=["peer"],
        )
        stood = CounterMetricFamily(
            "coadapt_router_peer_stood_seconds",
            "For how long the queue towards a host stood: the link to it was full.",
            labels=["peer"],
        )
        with self._lock:
            for name, host in sorted(self._hosts.items()):
                sent.add_metric([name], host.sent_bytes)
                stood.add_metric([name], host.stood_ms / 1e3)
        yield sent
        yield stood
