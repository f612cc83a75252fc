"""Where telemetry goes: counts what comes by UDP and TCP on one port, and throws it away.

`python -m network_controller.telemetry.sink --port P --seconds S` says `{"ready": P}` when it
listens, and at its end one JSON line with the bytes by protocol.
"""

from __future__ import annotations

import argparse
import json
import math
import selectors
import socket
import sys
import time
from contextlib import suppress

IDLE_S = 30.0
TURN = 256
"""Datagrams taken in a row: a flood must neither hide the stream nor the end."""
TCP_CHUNK = 256 * 1024
RECEIVE_BUFFER = 1 << 20
MAX_CONNECTIONS = 16


class Sink:
    """Sockets of both protocols on one port. Use as a context manager."""

    def __init__(self, host: str, port: int) -> None:
        """Raises OSError when the port is taken. Port 0 takes a free one."""
        self.received = {"udp": 0, "tcp": 0}
        self._selector = selectors.DefaultSelector()
        self._nothing = bytearray(TCP_CHUNK)
        self._heard_s = time.monotonic()
        self._connections = 0
        try:
            self._listener = socket.create_server((host, port))
            self._selector.register(self._listener, selectors.EVENT_READ)
            self.port: int = self._listener.getsockname()[1]
            self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._selector.register(self._datagrams, selectors.EVENT_READ)
            self._datagrams.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self._datagrams.bind((host, self.port))
        except OSError:
            self.close()
            raise
        self._listener.setblocking(False)
        self._datagrams.setblocking(False)

    def __enter__(self) -> Sink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all sockets."""
        for key in list(self._selector.get_map().values()):
            assert isinstance(key.fileobj, socket.socket)
            key.fileobj.close()
        self._selector.close()

    def run(self, seconds: float, idle_s: float = math.inf) -> None:
        """Takes what comes for so many seconds, or until nothing has come for `idle_s`."""
        end = time.monotonic() + seconds
        self._heard_s = time.monotonic()
        while (left := min(end, self._heard_s + idle_s) - time.monotonic()) > 0:
            for key, _ in self._selector.select(left):
                ready = key.fileobj
                assert isinstance(ready, socket.socket)
                with suppress(BlockingIOError):
                    if ready is self._listener:
                        self._accept()
                    elif ready is self._datagrams:
                        self._drain()
                    else:
                        self._read(ready)

    def _accept(self) -> None:
        connection, _ = self._listener.accept()
        if self._connections >= MAX_CONNECTIONS:
            connection.close()
            return
        connection.setblocking(False)
        self._selector.register(connection, selectors.EVENT_READ)
        self._connections += 1

    def _drain(self) -> None:
        for _ in range(TURN):
            # With MSG_TRUNC the kernel tells a datagram's length, and copies one byte only.
            self._count("udp", self._datagrams.recv_into(self._nothing, 1, socket.MSG_TRUNC))

    def _read(self, connection: socket.socket) -> None:
        try:
            size = connection.recv_into(self._nothing, TCP_CHUNK, socket.MSG_TRUNC)
        except BlockingIOError:
            return
        except OSError:
            size = 0
        if size:
            self._count("tcp", size)
            return
        self._selector.unregister(connection)
        self._connections -= 1
        connection.close()

    def _count(self, protocol: str, size: int) -> None:
        self.received[protocol] += size
        self._heard_s = time.monotonic()


def main() -> int:
    """Runs one sink; 1 when its port is taken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", default="0.0.0.0")
    parser.add_argument("--port", type=int, required=True, help="0: a free one")
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument(
        "--idle", type=float, default=IDLE_S, help=f"end when nothing comes (default: {IDLE_S:g} s)"
    )
    args = parser.parse_args()
    if not (0 <= args.port < 65_536 and 0 < args.seconds < math.inf and args.idle > 0):
        parser.error("--port must be 0 to 65535, --seconds and --idle above 0")
    try:
        with Sink(args.host, args.port) as sink:
            print(json.dumps({"ready": sink.port}), flush=True)
            sink.run(args.seconds, args.idle)
            print(json.dumps(sink.received), flush=True)
    except OSError as error:
        print(f"telemetry sink: port {args.port} on {args.host}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
