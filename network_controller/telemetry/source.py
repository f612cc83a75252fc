"""Telemetry as it fills a link: paced datagrams and a paced stream, marked as background.

`python -m network_controller.telemetry.source --to HOST --port P --rate-bps N --seconds S` sends at
that rate, headers included, and says at its end in one JSON line how many bytes went out.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import threading
import time
from contextlib import suppress

from swarm.traffic import TrafficClass

DATAGRAM = 1_200
UDP_HEADERS = 14 + 20 + 8
TCP_SHARE = 1448 / 1514
"""Payload of a full segment with time stamps, of its frame."""
TICK_S = 0.005
MAX_LAG_S = 0.1
"""After a longer pause of the machine the rest is not made up for: no burst."""
STREAM_CHUNK = 16 * 1024
RECONNECT_S = 0.5


class Source:
    """Sends to one sink until the time is over."""

    def __init__(self, host: str, port: int, seconds: float) -> None:
        self.sent = {"udp": 0, "tcp": 0}
        self._to = (host, port)
        self._end = time.monotonic() + seconds

    def datagrams(self, rate_bps: float) -> None:
        """Paced datagrams; it does not matter to them whether anybody is there."""
        data = bytes(DATAGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.BACKGROUND.tos)
            out.connect(self._to)
            due = time.monotonic()
            gap_s = (DATAGRAM + UDP_HEADERS) * 8.0 / rate_bps
            while (now := time.monotonic()) < self._end:
                due = max(due, now - MAX_LAG_S)
                while due <= now:
                    # Nobody listens yet, or not any more; the link is filled all the same.
                    with suppress(OSError):
                        out.send(data)
                        self.sent["udp"] += DATAGRAM
                    due += gap_s
                time.sleep(min(max(TICK_S, due - now), max(0.0, self._end - now)))

    def stream(self, rate_bps: float) -> None:
        """One TCP stream that is paced by a bucket; it is opened again when it breaks."""
        while time.monotonic() < self._end:
            try:
                with socket.socket() as out:
                    out.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.BACKGROUND.tos)
                    out.settimeout(max(0.01, self._end - time.monotonic()))
                    out.connect(self._to)
                    self._pour(out, rate_bps * TCP_SHARE / 8.0)
            except OSError:
                time.sleep(min(RECONNECT_S, max(0.0, self._end - time.monotonic())))

    def _pour(self, out: socket.socket, bytes_s: float) -> None:
        data = bytes(STREAM_CHUNK)
        due = time.monotonic()
        while (now := time.monotonic()) < self._end:
            due = max(due, now - MAX_LAG_S)
            if due > now:
                time.sleep(min(due - now, self._end - now))
                continue
            out.settimeout(max(0.01, self._end - now))
            sent = out.send(data[: max(1, min(STREAM_CHUNK, int(bytes_s * TICK_S * 4)))])
            self.sent["tcp"] += sent
            due += sent / bytes_s


def main() -> int:
    """Sends until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--to", required=True)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--rate-bps", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--protocol", choices=("udp", "tcp", "both"), default="both")
    args = parser.parse_args()
    source = Source(args.to, args.port, args.seconds)
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
