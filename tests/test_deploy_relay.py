"""The relay between the host's 127.0.0.1 and the swarm's network carries bytes unchanged."""

from __future__ import annotations

import asyncio
from pathlib import Path

from deploy.netns.relay import forwarder, serve_unix

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


def test_a_connection_to_nothing_is_closed(tmp_path: Path) -> None:
    async def run() -> bytes:
        near = await asyncio.start_unix_server(
            forwarder(lambda: asyncio.open_unix_connection(tmp_path / "missing.sock")),
            path=tmp_path / "near.sock",
        )
        async with near:
            return await asyncio.wait_for(_ask(tmp_path / "near.sock", b""), 30)

    assert asyncio.run(run()) == b""
