"""One marked flow between two hosts, as bytes by interval.

`python -m research.benchmarks.flow receive --port P --seconds S` counts what comes by TCP and UDP
from the first byte on, and prints one JSON line; `send` fills the link towards it.
"""

from __future__ import annotations

import argparse
import json
import selectors
import socket
import sys
import time
from contextlib import suppress

FIRST_BYTE_S = 20.0
DATAGRAM = 1_200
DATAGRAM_FRAME = DATAGRAM + 42
"""With the headers that `tc` counts."""


def receive(port: int, seconds: float, interval_s: float) -> dict[str, object]:
    """Bytes by interval, from the first one on, and when that came (`time.time_ns`)."""
    with (
        selectors.DefaultSelector() as selector,
        socket.create_server(("0.0.0.0", port)) as listener,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams,
    ):
        datagrams.bind(("0.0.0.0", port))
        for one in (listener, datagrams):
            selector.register(one, selectors.EVENT_READ)
        counts = [0] * round(seconds / interval_s)
        begun_ns, end = 0, time.monotonic() + FIRST_BYTE_S
        while time.monotonic() < end:
            for key, _ in selector.select(0.05):
                ready = key.fileobj
                assert isinstance(ready, socket.socket)
                if ready is listener:
                    selector.register(listener.accept()[0], selectors.EVENT_READ)
                    continue
                try:
                    size = len(ready.recv(1 << 20))
                except OSError:
                    size = 0
                if not size:
                    selector.unregister(ready)
                    continue
                if not begun_ns:
                    begun_ns, end = time.time_ns(), time.monotonic() + seconds
                at = int((time.time_ns() - begun_ns) / 1e9 / interval_s)
                if at < len(counts):
                    counts[at] += size
    return {"begun_ns": begun_ns, "bytes": counts}


def send(host: str, port: int, seconds: float, tos: int, protocol: str, rate_bps: float) -> None:
    """Sends as fast as TCP can, or datagrams at a rate, for so many seconds."""
    kind = socket.SOCK_STREAM if protocol == "tcp" else socket.SOCK_DGRAM
    with _connected(kind, host, port, tos) as out:
        out.settimeout(seconds)
        end = time.monotonic() + seconds
        if protocol == "tcp":
            with suppress(OSError):
                while time.monotonic() < end:
                    out.send(bytes(1 << 16))
            return
        data, gap_s, due = bytes(DATAGRAM), DATAGRAM_FRAME * 8 / rate_bps, time.monotonic()
        while (now := time.monotonic()) < end:
            while due <= now:
                with suppress(OSError):
                    out.send(data)
                due += gap_s
            time.sleep(min(0.002, max(0.0, due - now)))


def _connected(kind: socket.SocketKind, host: str, port: int, tos: int) -> socket.socket:
    """A marked socket, once the receiver is there."""
    until = time.monotonic() + FIRST_BYTE_S
    while True:
        out = socket.socket(socket.AF_INET, kind)
        try:
            out.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, tos)
            out.connect((host, port))
            return out
        except ConnectionRefusedError:
            out.close()
            if time.monotonic() >= until:
                raise
            time.sleep(0.05)


def main() -> int:
    """Receives or sends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("receive", "send"))
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--interval", type=float, default=1.0)
    parser.add_argument("--to", default="")
    parser.add_argument("--tos", type=int, default=0)
    parser.add_argument("--protocol", choices=("tcp", "udp"), default="tcp")
    parser.add_argument("--rate-bps", type=float, default=0.0)
    args = parser.parse_args()
    if args.what == "receive":
        print(json.dumps(receive(args.port, args.seconds, args.interval)))
    else:
        send(args.to, args.port, args.seconds, args.tos, args.protocol, args.rate_bps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
