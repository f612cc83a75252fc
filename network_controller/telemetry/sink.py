"""Where telemetry goes: counts what comes by UDP and TCP on one port, and throws it away.

`python -m network_controller.telemetry.sink --port P --seconds S` says `ready` when it listens, and
at its end one JSON line with the bytes by protocol.
"""

from __future__ import annotations

import argparse
import json
import selectors
import socket
import sys
import time
from contextlib import ExitStack

CHUNK = 256 * 1024
MAX_DATAGRAM = 65_536


class Sink:
    """Sockets of both protocols on one port. Use as a context manager."""

    def __init__(self, host: str, port: int) -> None:
        """Raises OSError when the port is taken. Port 0 takes a free one."""
        self.received = {"udp": 0, "tcp": 0}
        self._stack = ExitStack()
        self._selector = self._stack.enter_context(selectors.DefaultSelector())
        listener = self._stack.enter_context(socket.create_server((host, port)))
        self.port: int = listener.getsockname()[1]
        datagrams = self._stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        datagrams.bind((host, self.port))
        self._listener, self._datagrams = listener, datagrams
        for one in (listener, datagrams):
            one.setblocking(False)
            self._selector.register(one, selectors.EVENT_READ)

    def __enter__(self) -> Sink:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, seconds: float) -> None:
        """Takes what comes for so many seconds."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            for key, _ in self._selector.select(left):
                ready = key.fileobj
                assert isinstance(ready, socket.socket)
                if ready is self._listener:
                    self._accept()
                elif ready is self._datagrams:
                    self._drain()
                else:
                    self._read(ready)

    def _accept(self) -> None:
        connection, _ = self._listener.accept()
        connection.setblocking(False)
        self._selector.register(self._stack.enter_context(connection), selectors.EVENT_READ)

    def _drain(self) -> None:
        try:
            while True:
                self.received["udp"] += len(self._datagrams.recv(MAX_DATAGRAM))
        except BlockingIOError:
            return

    def _read(self, connection: socket.socket) -> None:
        try:
            data = connection.recv(CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        self.received["tcp"] += len(data)
        if not data:
            self._selector.unregister(connection)
            connection.close()


def main() -> int:
    """Runs one sink; 1 when its port is taken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", default="0.0.0.0")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    args = parser.parse_args()
    try:
        with Sink(args.host, args.port) as sink:
            print(json.dumps({"ready": sink.port}), flush=True)
            sink.run(args.seconds)
            print(json.dumps(sink.received), flush=True)
    except OSError as error:
        print(f"telemetry sink: port {args.port} on {args.host}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
