"""Messages of a running ego as datagrams: over real Zenoh and UDP."""

from __future__ import annotations

import socket
import threading

import msgspec
import pytest

from options.etsi import modules
from options.etsi.anchor import Anchor
from options.etsi.message import decode
from options.etsi.station import Station
from options.etsi.telling import Sent, send
from swarm import keyspace
from swarm.messages import Beacon, Detections
from swarm.session import Session
from tests.support.message_samples import SAMPLES
from tests.support.zenoh_fixtures import WAIT_S, RouterProcess

DOUBTED = next(one for one in SAMPLES if isinstance(one, Detections))
FOUND = msgspec.structs.replace(
    DOUBTED, known=tuple(msgspec.structs.replace(one, doubt="") for one in DOUBTED.known)
)
BEACON = next(one for one in SAMPLES if isinstance(one, Beacon))


@pytest.mark.peer
def test_what_an_ego_found_leaves_as_datagrams(shared_router: RouterProcess) -> None:
    pytest.importorskip("asn1tools", reason="asn1tools is missing: run make setup")
    if not modules.are_there():
        pytest.skip("ETSI's modules are missing: coadapt cpm modules")
    swarm, stop, said = "etsi", threading.Event(), threading.Event()
    ended: list[Sent] = []
    station = Station(9, Anchor(48.8, 2.4))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there,
        Session(shared_router.address, swarm) as ego,
    ):
        there.bind(("127.0.0.1", 0))
        there.settimeout(WAIT_S)
        to = ("127.0.0.1", there.getsockname()[1])
        address = shared_router.address
        beacon = msgspec.structs.replace(BEACON, robot="R2")
        sender = threading.Thread(
            target=lambda: ended.append(send(address, swarm, "R2", station, to, stop, str)),
            daemon=True,
        )

        def speak() -> None:
            """As the ego and its robot do, again and again."""
            while not said.wait(0.05):
                ego.put(keyspace.beacon(swarm, "R2"), beacon)
                ego.put(keyspace.detections(swarm, "R2"), FOUND)

        speaker = threading.Thread(target=speak, daemon=True)
        for thread in (sender, speaker):
            thread.start()
        try:
            raw = there.recv(65_536)
        finally:
            said.set()
            stop.set()
            speaker.join(WAIT_S)
            sender.join(WAIT_S)
    message = decode(raw)
    assert message.station == 9
    assert {one.label for one in message.objects} == {"forklift", "other"}
    # The same frame again is no news.
    (sent,) = ended
    assert (sent.messages, sent.bytes, sent.ended) == (1, len(raw), "stopped")
