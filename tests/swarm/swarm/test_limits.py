"""What is too large stops before it costs memory: at the router, and in whoever listens."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import zenoh

from swarm import keyspace
from swarm.messages import MAX_MESSAGE_BYTES, Beacon, encode
from swarm.zenoh_config import CONTROL_BYTES
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import WAIT_S, Inbox, RouterProcess, until

OVERSIZE_BYTES = 300_000_000
MAY_GROW_MB = 30
SWARM = "limits"
PROBE = f"coadapt/{SWARM}/probe"
BEACON = next(sample for sample in SAMPLES if isinstance(sample, Beacon))
LISTENER = f"""
import sys
from swarm import keyspace
from swarm.messages import Beacon
from swarm.session import Session

with Session(sys.argv[1], {SWARM!r}, timeout_s={WAIT_S}) as session:
    session.subscribe(
        keyspace.beacon({SWARM!r}, keyspace.ANY), Beacon, lambda b: print(b.robot, flush=True)
    )
    print("listens", flush=True)
    sys.stdin.read()
"""


def peak_mb(pid: int) -> float:
    """The most memory that a process has held."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


@contextmanager
def client(router: RouterProcess) -> Iterator[zenoh.Session]:
    """A Zenoh client that keeps to nothing of ours."""
    config = {
        "mode": "client",
        "connect": {"endpoints": [router.address]},
        "scouting": {"multicast": {"enabled": False}},
    }
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    try:
        yield session
    finally:
        session.close()


def put(session: zenoh.Session, key: str, data: bytes) -> None:
    session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)


def test_three_hundred_megabytes_cost_nobody_their_memory(own_router: RouterProcess) -> None:
    key = keyspace.beacon(SWARM, BEACON.robot)
    with subprocess.Popen(
        [sys.executable, "-c", LISTENER, own_router.address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as listener:
        assert listener.stdout is not None
        assert listener.stdout.readline() == "listens\n"
        assert own_router._process is not None
        pids = own_router._process.pid, listener.pid
        before = [peak_mb(pid) for pid in pids]
        # The sender's connection is closed on the way, which it may be told or not.
        with client(own_router) as stranger, suppress(zenoh.ZError):
            put(stranger, key, bytes(OVERSIZE_BYTES))
        with client(own_router) as other:
            put(other, key, encode(BEACON))
            assert listener.stdout.readline() == f"{BEACON.robot}\n"
        grown = [peak_mb(pid) - old for pid, old in zip(pids, before, strict=True)]
        listener.kill()
    assert max(grown) <= MAY_GROW_MB


def test_control_keys_carry_no_more_than_they_need(own_router: RouterProcess) -> None:
    heard: Inbox[tuple[str, int]] = Inbox()
    other = keyspace.decision(SWARM, "R1")
    beacon = CONTROL_BYTES["coadapt/*/robot/*/beacon/**"]
    limits = {
        keyspace.beacon(SWARM, "R1"): beacon,
        keyspace.within(keyspace.beacon(SWARM, "R1"), "3_-4"): beacon,
        keyspace.scene(SWARM, "R1"): CONTROL_BYTES["coadapt/*/robot/*/scene/**"],
        keyspace.net_state(SWARM): CONTROL_BYTES["coadapt/*/net/**"],
    }
    with client(own_router) as stranger, client(own_router) as listener:
        listener.declare_subscriber(
            f"coadapt/{SWARM}/**",
            lambda sample: heard.put((str(sample.key_expr), len(sample.payload.to_bytes()))),
        )
        until(lambda: _reaches(stranger, heard), "the subscriber is known to the sender")
        for key, limit in limits.items():
            put(stranger, key, bytes(limit + 1))
            put(stranger, key, bytes(limit))
        put(stranger, other, bytes(MAX_MESSAGE_BYTES))
        for sent in (*limits.items(), (other, MAX_MESSAGE_BYTES)):
            assert heard.next_where(lambda got: got[0] != PROBE) == sent


def _reaches(sender: zenoh.Session, heard: Inbox[tuple[str, int]]) -> bool:
    put(sender, PROBE, b"")
    time.sleep(0.05)
    return not heard.empty()
