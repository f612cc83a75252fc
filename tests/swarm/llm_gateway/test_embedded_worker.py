"""The embedded back end with its worker process: crashes, time limits, bad files."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import pytest

from llm_gateway.backends.llamacpp.client import LlamaCpp
from llm_gateway.backends.llamacpp.models import find_model
from llm_gateway.model import Prompt
from swarm.errors import GatewayError, SettingError
from swarm.log import make_logger
from tests.support.embedded_model import CONTEXT, SEQUENCES, ask

pytestmark = pytest.mark.model

pytest_plugins = ("tests.support.embedded_fixtures",)

LONG = Prompt(ask("Tell a long story.").messages, "", 300)


@contextlib.asynccontextmanager
async def running(path: Path) -> AsyncIterator[LlamaCpp]:
    log = make_logger("test", level="critical")
    backend = LlamaCpp(path, SEQUENCES, CONTEXT, 2, log)
    await backend.start()
    try:
        yield backend
    finally:
        await backend.close()


async def answers_again(backend: LlamaCpp) -> None:
    while True:
        try:
            await backend.complete(ask("Link: 1"), 60)
            return
        except GatewayError as error:
            if error.code != "unavailable":
                raise
            await asyncio.sleep(0.05)


async def under_way(backend: LlamaCpp) -> asyncio.Task[object]:
    """A long prompt that the worker has begun with."""
    task: asyncio.Task[object] = asyncio.create_task(backend.complete(LONG, 60))
    await backend.complete(ask("Link: 2", max_tokens=1), 60)
    return task


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGILL])
def test_a_worker_that_dies_fails_what_it_had_and_is_replaced(
    model_file: Path,
    number: signal.Signals,
) -> None:
    async def story() -> None:
        async with running(model_file) as backend:
            task = await under_way(backend)
            dead = backend.pid
            assert dead is not None
            os.kill(dead, number)
            with pytest.raises(GatewayError, match=rf"^failed: .*{number.name}"):
                await task
            with pytest.raises(GatewayError, match=r"^unavailable: .*started again"):
                await backend.complete(ask("a"), 1)
            await answers_again(backend)
            assert backend.pid != dead
            assert not alive(dead)

    asyncio.run(story())


def test_a_prompt_that_fails_in_the_model_leaves_the_worker_alive(model_file: Path) -> None:
    async def story() -> None:
        async with running(model_file) as backend:
            pid = backend.pid
            with pytest.raises(GatewayError, match=r"^failed: no token could be chosen"):
                await backend.complete(replace(ask("a"), temperature=math.nan), 60)
            await backend.complete(ask("a"), 60)
            assert backend.pid == pid

    asyncio.run(story())


def test_time_out_and_cancelling_leave_the_worker_free(model_file: Path) -> None:
    async def story() -> None:
        async with running(model_file) as backend:
            with pytest.raises(GatewayError, match=r"^expired: "):
                await backend.complete(LONG, 0.01)
            tasks = [asyncio.create_task(backend.complete(LONG, 60)) for _ in range(SEQUENCES)]
            await asyncio.sleep(0)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            assert (await backend.complete(ask("Link: 3"), 60)).text.startswith("{")

    asyncio.run(story())


def test_closing_ends_the_worker_and_what_is_under_way(model_file: Path) -> None:
    async def story() -> None:
        async with running(model_file) as backend:
            pid = backend.pid
            task = await under_way(backend)
        with pytest.raises(GatewayError, match=r"^unavailable: "):
            await task
        assert pid is not None
        assert not alive(pid)
        with pytest.raises(GatewayError, match=r"^unavailable: "):
            await backend.complete(ask("a"), 1)

    asyncio.run(story())


def test_a_worker_ends_with_its_input(model_file: Path) -> None:
    command = [sys.executable, "-m", "llm_gateway.backends.llamacpp.worker"]
    command += ["--model", str(model_file), "--parallel", "1", "--context", "64", "--threads", "1"]
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    assert ended.returncode == 0


@pytest.mark.parametrize("size", [1000, 5_000_000])
def test_a_truncated_file_is_a_setting_error(
    model_file: Path,
    tmp_path: Path,
    size: int,
) -> None:
    cut = tmp_path / "cut.gguf"
    cut.write_bytes(model_file.read_bytes()[:size])

    async def story() -> None:
        async with running(cut):
            pass

    with pytest.raises(SettingError, match=r"cut\.gguf is not a model"):
        asyncio.run(story())


def test_a_name_that_is_no_model_says_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"neither a file, nor one of smollm2-135m, gemma3-270m"):
        find_model("frog")
    text = tmp_path / "notes.gguf"
    text.write_text("hello")
    with pytest.raises(SettingError, match="does not begin with GGUF"):
        find_model(str(text))
