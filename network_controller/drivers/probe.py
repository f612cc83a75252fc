"""What this kernel can do for links, found out by trying."""

from __future__ import annotations

import hashlib
from contextlib import suppress

from network_controller.drivers.command import attempt, words
from network_controller.model import FEATURES, Capabilities
from swarm.errors import NetworkError


def probe(swarm: str) -> Capabilities:
    """Tries every feature on a pair of devices of its own, and removes them.

    The devices' names follow from the swarm's: what a killed probe left is found by the next one,
    and two swarms on one host do not meet. Raises NetworkError when no device can be made: then
    links cannot be shaped at all.
    """
    token = hashlib.blake2s(swarm.encode(), digest_size=4).hexdigest()
    device, peer, ifb = (f"{kind}-{token}" for kind in ("probe", "peer", "tryifb"))
    for one in (device, ifb):
        attempt("ip", "link", "del", one)
    made = attempt("ip", "link", "add", device, "type", "veth", "peer", "name", peer)
    if made.returncode != 0:
        raise NetworkError(
            f"links cannot be shaped here: {words(made)}; the controller needs NET_ADMIN in the "
            "network namespace of the links"
        )
    missing: dict[str, str] = {}
    try:
        for feature, argv in _trials(device, peer, ifb):
            done = attempt(*argv)
            if done.returncode != 0:
                missing[feature] = words(done)
    finally:
        for one in (device, ifb):
            with suppress(NetworkError):
                attempt("ip", "link", "del", one)
    return Capabilities(frozenset(FEATURES) - frozenset(missing), missing)


def _trials(device: str, peer: str, ifb: str) -> list[tuple[str, tuple[str, ...]]]:
    """What to run for each feature, in an order in which each finds what it needs."""
    add = ("tc", "qdisc", "add", "dev", device)
    root = ("tc", "qdisc", "replace", "dev", device, "root")
    rule = ("tc", "filter", "add", "dev", device, "parent")
    everything = ("u32", "match", "u32", "0", "0")
    redirect = ("action", "mirred", "egress", "redirect", "dev", peer)
    return [
        ("ifb", ("ip", "link", "add", ifb, "type", "ifb")),
        ("clsact", (*add, "clsact")),
        ("mirred", (*rule[:-1], "egress", "protocol", "all", "prio", "1", *everything, *redirect)),
        ("netem", (*root, "netem", "delay", "1ms")),
        ("fq_codel", (*root, "fq_codel")),
        ("bfifo", (*root, "bfifo", "limit", "10000")),
        ("htb", (*root, "handle", "1:", "htb", "default", "1")),
        ("u32", (*rule, "1:", "protocol", "ip", "prio", "1", *everything, "flowid", "1:1")),
    ]
