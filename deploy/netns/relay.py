"""Byte relays between the host's 127.0.0.1 and the swarm's network, which share no network.

A Unix socket in the run directory crosses network namespaces: the supervisor listens on it and
connects to the service inside; `python -m deploy.netns.relay RUN_DIR FD=SOCKET ...` runs on the
host, accepts on the inherited listening socket FD and connects to SOCKET. The other way,
SOCKET=HOST:PORT lets the swarm reach that one address outside. It ends with the supervisor, whose
control socket it holds a connection to.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

from deploy.netns import control

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]
CHUNK = 64 * 1024
CONNECT_S = 5.0
REACHED, AWAY = b"1", b"0"
"""The first byte of a connection to the way out: whether the address outside was reached."""


def forwarder(
    connect: Callable[[], Awaitable[Streams]], *, tell: bool = False
) -> Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]:
    """A connection handler that copies bytes both ways to what `connect` opens, and passes on the
    end of either direction while the other still flows. With `tell` it says first whether there is
    a connection."""

    async def forward(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            far_reader, far_writer = await connect()
        except OSError:
            if tell:
                writer.write(AWAY)
            writer.close()
            return
        if tell:
            writer.write(REACHED)
        try:
            await asyncio.gather(_copy(reader, far_writer), _copy(far_reader, writer))
        finally:
            for end in (writer, far_writer):
                end.close()

    return forward


async def _copy(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    try:
        while data := await source.read(CHUNK):
            target.write(data)
            await target.drain()
        if target.can_write_eof():
            target.write_eof()
    except OSError:
        target.close()  # Who waits there for an answer learns that none will come.


async def serve_unix(path: Path, host: str, port: int) -> asyncio.Server:
    """Listens on a Unix socket and forwards to an address in this network namespace."""
    return await asyncio.start_unix_server(
        forwarder(lambda: asyncio.open_connection(host, port)), path=path
    )


async def _run(run_dir: Path, endpoints: list[tuple[str, str]]) -> None:
    alive, _ = await asyncio.open_unix_connection(run_dir / control.SOCKET)
    servers = [await _serve(source, target) for source, target in endpoints]
    await alive.read()
    for server in servers:
        server.close()


async def _serve(source: str, target: str) -> asyncio.Server:
    if source.isdecimal():
        inwards = forwarder(lambda: asyncio.open_unix_connection(target))
        return await asyncio.start_server(inwards, sock=socket.socket(fileno=int(source)))
    host, _, port = target.rpartition(":")
    return await serve_outside(Path(source), host, int(port))


async def serve_outside(path: Path, host: str, port: int) -> asyncio.Server:
    """Listens on a Unix socket and forwards to an address outside, after the byte that says whether
    it was reached."""

    async def connect() -> Streams:
        async with asyncio.timeout(CONNECT_S):
            return await asyncio.open_connection(host, port)

    return await asyncio.start_unix_server(forwarder(connect, tell=True), path=path)


def main() -> int:
    """Relays until the supervisor ends."""
    run_dir, *pairs = sys.argv[1:]
    endpoints = [(left, right) for left, _, right in (pair.partition("=") for pair in pairs)]
    try:
        asyncio.run(_run(Path(run_dir), endpoints))
    except OSError as error:
        print(f"deploy.netns.relay: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
