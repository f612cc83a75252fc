"""The relay between the host's 127.0.0.1 and the swarm's network carries bytes unchanged."""

from __future__ import annotations

import asyncio
import socket
import struct
import sys
from pathlib import Path

import pytest

from deploy.netns import control
from deploy.netns.outside import StandIn
from deploy.netns.relay import AWAY, REACHED, forwarder, serve_outside, serve_unix
from tests.support.free_ports import free_port

SIZE = 3_000_000


async def _ask(path: Path, question: bytes) -> bytes:
    reader, writer = await asyncio.open_unix_connection(path)
    writer.write(question)
    # The end of the question is what the other side waits for before it answers.
    writer.write_eof()
    answer = await reader.read()
    writer.close()
    await writer.wait_closed()
    return answer


def test_both_directions_flow_and_a_half_close_is_passed_on(tmp_path: Path) -> None:
    async def reverse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write((await reader.read())[::-1])
        await writer.drain()
        writer.close()

    async def run() -> bytes:
        far = await asyncio.start_server(reverse, "127.0.0.1", 0)
        port = far.sockets[0].getsockname()[1]
        near = await serve_unix(tmp_path / "near.sock", "127.0.0.1", port)
        async with far, near:
            return await asyncio.wait_for(_ask(tmp_path / "near.sock", b"ab" * SIZE), 30)

    assert asyncio.run(run()) == b"ba" * SIZE


def test_the_relay_leads_to_one_address_outside_and_ends_with_the_supervisor(
    tmp_path: Path,
) -> None:
    async def shout(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write((await reader.read()).upper())
        writer.close()

    async def run() -> tuple[bytes, int]:
        alive: asyncio.Queue[asyncio.StreamWriter] = asyncio.Queue()
        supervisor = await asyncio.start_unix_server(
            lambda _, writer: alive.put_nowait(writer), path=tmp_path / control.SOCKET
        )
        server = await asyncio.start_server(shout, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        way = tmp_path / "server.sock"
        relay = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "deploy.netns.relay", str(tmp_path)),
            f"{way}=127.0.0.1:{port}",
        )
        async with supervisor, server, asyncio.timeout(30):
            end = await alive.get()
            while not way.exists():
                await asyncio.sleep(0.01)
            answer = await _ask(way, b"tokens")
            server.close()
            await server.wait_closed()
            assert await _ask(way, b"") == AWAY
            end.close()
            return answer, await relay.wait()

    assert asyncio.run(run()) == (REACHED + b"TOKENS", 0)


def test_a_server_outside_that_is_away_refuses_inside_until_it_is_back(tmp_path: Path) -> None:
    async def shout(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write((await reader.read(100)).upper())
        writer.close()

    async def ask(port: int) -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"tokens")
        try:
            return await reader.read()
        finally:
            writer.close()

    async def run() -> bytes:
        inside, outside = free_port(), free_port()
        way = tmp_path / "server.sock"
        stand_in = StandIn(way, "127.0.0.1", inside)
        await stand_in.open()
        first = asyncio.create_task(ask(inside))
        # The relay starts after the swarm.
        async with asyncio.timeout(30), await serve_outside(way, "127.0.0.1", outside):
            assert await first == b""
            with pytest.raises(ConnectionRefusedError):
                await ask(inside)
            async with await asyncio.start_server(shout, "127.0.0.1", outside):
                while True:
                    try:
                        answer = await ask(inside)
                    except ConnectionRefusedError:
                        await asyncio.sleep(0.05)
                    else:
                        stand_in.close()
                        return answer

    assert asyncio.run(run()) == b"TOKENS"


def test_a_connection_to_nothing_is_closed(tmp_path: Path) -> None:
    async def run() -> bytes:
        near = await asyncio.start_unix_server(
            forwarder(lambda: asyncio.open_unix_connection(tmp_path / "missing.sock")),
            path=tmp_path / "near.sock",
        )
        async with near:
            return await asyncio.wait_for(_ask(tmp_path / "near.sock", b""), 30)

    assert asyncio.run(run()) == b""


def test_a_connection_that_breaks_beyond_ends_on_this_side_too(tmp_path: Path) -> None:
    async def breaks(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Closed with what was asked unread, as a server does that was held up for long: a reset.
        link = writer.get_extra_info("socket")
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        await reader.read(1)
        writer.transport.abort()

    async def run() -> bytes:
        far = await asyncio.start_server(breaks, "127.0.0.1", 0)
        port = far.sockets[0].getsockname()[1]
        near = await serve_unix(tmp_path / "near.sock", "127.0.0.1", port)
        async with far, near, asyncio.timeout(30):
            reader, writer = await asyncio.open_unix_connection(tmp_path / "near.sock")
            writer.write(b"still here")
            end = await reader.read()
            writer.close()
            return end

    assert asyncio.run(run()) == b""
