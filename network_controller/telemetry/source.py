"""Telemetry as it fills a link: paced datagrams and a paced stream, marked as background.

`python -m network_controller.telemetry.source --to HOST --port P --rate-bps N --seconds S` sends at
that rate, headers included as `tc` counts them, and says at its end in one JSON line how many bytes
of payload went out.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from swarm.traffic import TrafficClass

DATAGRAM = 1_200
UDP_HEADERS = 14 + 20 + 8
TCP_SHARE = 1448 / 1514
"""Payload of a full segment with time stamps, of its frame."""
TICK_S = 0.005
MAX_LAG_S = 0.1
"""After a longer pause of the machine the rest is not made up for: no burst."""
MIN_CHUNK, MAX_CHUNK = 1448, 64 * 1024
CHUNK_S = 0.02
RECONNECT_S = 0.5
GRACE_S = 0.5
"""How long a stream may need at its end for what it has sent already."""


class Source:
    """Sends to one sink until the time is over, whether it is there or not."""

    def __init__(
        self, host: str, port: int, seconds: float, wanted: Callable[[], bool] = lambda: True
    ) -> None:
        """`host` is an IPv4 address. It ends early, too, once `wanted` says no."""
        self.sent = {"udp": 0, "tcp": 0}
        """Bytes of payload that the kernel took."""
        self.to = (host, port)
        self._end = time.monotonic() + seconds
        self._wanted = wanted

    def datagrams(self, rate_bps: float) -> None:
        """Paced datagrams; it does not matter to them whether anybody is there."""
        data = bytes(DATAGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            _mark(out)
            # A full queue must drop telemetry, not slow it down until it fits.
            out.setblocking(False)
            due = time.monotonic()
            gap_s = (DATAGRAM + UDP_HEADERS) * 8.0 / rate_bps
            while self._left():
                now = time.monotonic()
                due = max(due, now - MAX_LAG_S)
                while due <= now:
                    # Also when nobody listens yet, or not any more: the link is filled all the
                    # same.
                    with suppress(OSError):
                        self.sent["udp"] += out.sendto(data, self.to)
                    due += gap_s
                self._sleep(max(TICK_S, due - time.monotonic()))

    def stream(self, rate_bps: float) -> None:
        """One TCP stream that is paced by a bucket; it is opened again when it breaks."""
        while self._left():
            try:
                with socket.socket() as out:
                    _mark(out)
                    # What a link cannot carry in time is thrown away, not sent after the end.
                    out.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    out.settimeout(max(TICK_S, self._end - time.monotonic()))
                    out.connect(self.to)
                    self._pour(out, rate_bps * TCP_SHARE / 8.0)
                    out.shutdown(socket.SHUT_WR)
                    out.settimeout(GRACE_S)
                    out.recv(1)
            except OSError:
                self._sleep(RECONNECT_S)

    def _pour(self, out: socket.socket, bytes_s: float) -> None:
        data = bytes(int(min(MAX_CHUNK, max(MIN_CHUNK, bytes_s * CHUNK_S))))
        due = time.monotonic()
        while self._left():
            now = time.monotonic()
            due = max(due, now - MAX_LAG_S)
            if due > now:
                self._sleep(due - now)
                continue
            # Not longer than this, so that a stream that is stuck sees its end.
            out.settimeout(max(TICK_S, min(RECONNECT_S, self._end - now)))
            with suppress(TimeoutError):
                sent = out.send(data)
                self.sent["tcp"] += sent
                due += sent / bytes_s

    def _left(self) -> bool:
        return time.monotonic() < self._end and self._wanted()

    def _sleep(self, seconds: float) -> None:
        time.sleep(max(0.0, min(seconds, RECONNECT_S, self._end - time.monotonic())))


def _mark(out: socket.socket) -> None:
    out.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.BACKGROUND.tos)


def main() -> int:
    """Sends until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--to", required=True, help="IPv4 address")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--rate-bps", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--protocol", choices=("udp", "tcp", "both"), default="both")
    parser.add_argument(
        "--parent", type=int, metavar="PID", help="end once this process, its parent, has ended"
    )
    args = parser.parse_args()
    if not (
        0 < args.port < 65_536 and 0 < args.rate_bps < math.inf and 0 < args.seconds < math.inf
    ):
        parser.error("--port must be 1 to 65535, --rate-bps and --seconds above 0")
    wanted = (lambda: True) if args.parent is None else (lambda: os.getppid() == args.parent)
    source = Source(args.to, args.port, args.seconds, wanted)
    parts = {"udp": [source.datagrams], "tcp": [source.stream]}.get(
        args.protocol, [source.datagrams, source.stream]
    )
    threads = [threading.Thread(target=p, args=(args.rate_bps / len(parts),)) for p in parts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(json.dumps(source.sent), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
