"""Whether a process of this machine answers: `python -m swarm.health PORT`, for engines that ask.

It asks for the process's metrics. That the process's own loops turn is not asked here: it watches
them itself (`swarm.loop_watch`).
"""

from __future__ import annotations

import argparse
import socket
import ssl
import sys

TIMEOUT_S = 4.0
_ENOUGH = 64


def trouble(port: int, host: str = "127.0.0.1", *, tls: bool = False) -> str:
    """Why a process's metrics do not answer; empty where they do. Over TLS any certificate will do:
    who else would answer on this machine's port is not asked here."""
    try:
        connected = socket.create_connection((host, port), TIMEOUT_S)
        with _unverified().wrap_socket(connected) if tls else connected as connection:
            connection.sendall(b"GET /metrics HTTP/1.0\r\nHost: localhost\r\n\r\n")
            status = connection.recv(_ENOUGH).split(b"\r\n")[0]
    except OSError as error:
        return f"port {port} does not answer: {error}"
    if status.split()[1:2] == [b"200"]:
        return ""
    return f"port {port} answers {status.decode(errors='replace')!r}"


def _unverified() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def main() -> int:
    """Returns 0 where the process answers, else 1 and says why."""
    parser = argparse.ArgumentParser(prog="python -m swarm.health", description=__doc__)
    parser.add_argument("port", type=int, help="where the process serves /metrics")
    parser.add_argument("--tls", action="store_true", help="it serves them over TLS")
    args = parser.parse_args()
    said = trouble(args.port, tls=args.tls)
    if said:
        print(said, file=sys.stderr)
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
