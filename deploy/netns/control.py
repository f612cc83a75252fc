"""The supervisor's control socket: JSON lines, one request and one reply at a time."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Literal

import msgspec

from deploy.netns.children import ChildStatus
from swarm.errors import DeployError

SOCKET = "control.sock"
TIMEOUT_S = 5.0


class Request(msgspec.Struct, frozen=True):
    """What a tool on the host asks of the supervisor."""

    command: Literal["status", "stop", "kill"]
    service: str = ""
    signal: int = 15


class Reply(msgspec.Struct, frozen=True):
    """The supervisor's answer; `error` is empty when the request was carried out."""

    error: str = ""
    services: tuple[ChildStatus, ...] = ()


def connect(run_dir: Path) -> socket.socket | None:
    """A connection to the supervisor, or None when none listens. It ends with the supervisor."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(TIMEOUT_S)
    try:
        connection.connect(str(run_dir / SOCKET))
    except OSError:
        connection.close()
        return None
    return connection


def ask(run_dir: Path, request: Request) -> Reply | None:
    """The supervisor's reply, or None when no supervisor answers there.

    Raises DeployError when it refuses the request.
    """
    connection = connect(run_dir)
    if connection is None:
        return None
    with connection, connection.makefile("rwb") as stream:
        try:
            stream.write(msgspec.json.encode(request) + b"\n")
            stream.flush()
            line = stream.readline()
        except OSError:
            return None
    if not line:
        return None
    reply = msgspec.json.decode(line, type=Reply)
    if reply.error:
        raise DeployError(f"{request.command} {request.service}: {reply.error}")
    return reply
