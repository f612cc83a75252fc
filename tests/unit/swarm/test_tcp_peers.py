"""What a router tells of the hosts at the other ends of its connections."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, generate_latest

from swarm.messages import Backlog
from swarm.tcp.peers import MAX_PEERS, PeerTraffic


def shown(traffic: PeerTraffic, metric: str, peer: str) -> float | None:
    registry = CollectorRegistry()
    registry.register(traffic)
    assert generate_latest(registry)
    return registry.get_sample_value(f"coadapt_router_peer_{metric}_total", {"peer": peer})


def sent(count: int, stood_ms: int = 0) -> Backlog:
    return Backlog(sent_bytes=count, stood_ms=stood_ms)


def test_connections_of_a_host_count_together_and_never_backwards() -> None:
    traffic = PeerTraffic()
    traffic.take({"10.0.0.7:4000": sent(1000, 500), "10.0.0.7:4001": sent(10)})
    assert shown(traffic, "sent_bytes", "10.0.0.7") == 1010
    assert shown(traffic, "stood_seconds", "10.0.0.7") == 0.5
    # One has ended, and another one begins.
    traffic.take({"10.0.0.7:4001": sent(20), "10.0.0.7:4002": sent(5)})
    assert shown(traffic, "sent_bytes", "10.0.0.7") == 1025
    traffic.take({})
    # From a port that was used before.
    traffic.take({"10.0.0.7:4001": sent(3)})
    traffic.take({"10.0.0.7:4001": sent(1)})
    assert shown(traffic, "sent_bytes", "10.0.0.7") == 1029
    assert shown(traffic, "stood_seconds", "10.0.0.7") == 0.5


def test_an_address_of_ipv6_is_one_host() -> None:
    traffic = PeerTraffic()
    traffic.take({"[fd00::7]:4000": sent(1)})
    assert shown(traffic, "sent_bytes", "fd00::7") == 1


def test_more_hosts_than_are_told_apart_are_the_others() -> None:
    traffic = PeerTraffic()
    for number in range(MAX_PEERS + 3):
        traffic.take({f"10.0.{number // 250}.{number % 250}:1": sent(1)})
    assert shown(traffic, "sent_bytes", "others") == 3
