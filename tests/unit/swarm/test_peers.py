"""A router says which routers of other machines it has, and why one is away."""

from __future__ import annotations

import queue

import structlog

from swarm.peers import Peers
from swarm.transport import TELL_S
from tests.support.free_ports import free_ports
from tests.support.zenoh_fixtures import WAIT_S


class Said:
    """A log that keeps what it is told, from whichever thread."""

    def __init__(self) -> None:
        self.lines: queue.Queue[tuple[str, str]] = queue.Queue()

    def __call__(self, _: object, __: str, line: structlog.typing.EventDict) -> str:
        self.lines.put((str(line["event"]), str(line.get("why", ""))))
        raise structlog.DropEvent

    def next(self) -> tuple[str, str]:
        return self.lines.get(timeout=WAIT_S)


def test_a_peer_that_comes_goes_and_stays_away_is_told() -> None:
    said, now = Said(), [0.0]
    log = structlog.wrap_logger(structlog.PrintLogger(), processors=[said])
    port = free_ports(3)
    peers = Peers([f"tcp/127.0.0.1:{port}"], None, log, lambda: now[0])
    # Ports of its own processes, and of other machines, are not the peer's.
    peers.look([f"tcp/127.0.0.1:{port + 3}", f"tcp/10.0.0.1:{port}", "unixsock-stream//x"])
    assert said.lines.empty()
    peers.look([f"tcp/127.0.0.1:{port + n}" for n in range(3)])
    assert said.next() == ("peer_linked", "")
    peers.look([])
    assert said.next() == ("peer_lost", "")
    now[0] += TELL_S
    peers.look([])
    told = f"127.0.0.1 is there, but nothing listens on its port {port}"
    assert said.next() == ("peer_away", told)
    peers.look([])
    assert said.lines.empty()
