"""The back end `openai` with a real model behind a real server: llama-cpp-python's own."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import subprocess
import sys
import urllib.request
from collections.abc import Generator
from pathlib import Path

import pytest

from llm_gateway.backends.llamacpp.models import find_model
from llm_gateway.backends.openai import OpenAi
from llm_gateway.model import Prompt, Reply
from swarm.errors import GatewayError, SettingError
from swarm.log import make_logger
from swarm.messages import ChatMessage
from tests.support.free_ports import free_port
from tests.support.zenoh_fixtures import until

pytestmark = pytest.mark.model

NEEDED = ("llama_cpp", "fastapi", "sse_starlette", "starlette_context", "pydantic_settings")
SCHEMA = {
    "type": "object",
    "properties": {
        "participants": {"type": "array", "items": {"enum": ["R1", "R2"]}, "maxItems": 2},
        "algorithm": {"enum": ["late"]},
    },
    "required": ["participants", "algorithm"],
    "additionalProperties": False,
}
CONTEXT = 512


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    """Its address."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)} (extras llm and llm-server)")
    try:
        model = find_model("smollm2-135m")
    except SettingError as error:
        pytest.skip(str(error))
    port = free_port()
    said = tmp_path_factory.mktemp("llama") / "server.log"
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "llama_cpp.server", "--model", str(model)]
    # More threads would wait for each other by spinning, which a busy machine cannot afford.
    threads = ["--n_threads", "1", "--n_threads_batch", "1"]
    options = ["--port", str(port), "--n_ctx", str(CONTEXT), *threads]
    with said.open("wb") as log:
        process = subprocess.Popen([*command, *options], stdout=log, stderr=log)
    try:
        until(lambda: _up(process, url, said), "the model server answers", 60)
        yield url
    finally:
        process.kill()
        process.wait()


def _up(process: subprocess.Popen[bytes], url: str, said: Path) -> bool:
    assert process.poll() is None, said.read_text()[-2000:]
    try:
        with urllib.request.urlopen(f"{url}/v1/models", timeout=5):
            return True
    except OSError:
        return False


def replies(url: str, *prompts: Prompt) -> list[Reply]:
    async def run() -> list[Reply]:
        backend = OpenAi(url, "", "", 1, make_logger("test", level="critical"))
        await backend.start()
        try:
            return [await backend.complete(prompt, 60) for prompt in prompts]
        finally:
            await backend.close()

    return asyncio.run(run())


def prompt(text: str) -> Prompt:
    return Prompt((ChatMessage("user", text),), json.dumps(SCHEMA), 64)


def test_its_answers_follow_the_schema(server: str) -> None:
    for reply in replies(server, prompt("Which robots take part?"), prompt("Who else?")):
        decision = json.loads(reply.text)
        assert set(decision) == {"participants", "algorithm"}
        assert set(decision["participants"]) <= {"R1", "R2"}
        assert decision["algorithm"] == "late"
        assert reply.tokens.prompt > 0
        assert reply.tokens.output > 0


def test_a_prompt_that_does_not_fit_its_context_is_too_large(server: str) -> None:
    with pytest.raises(GatewayError) as caught:
        replies(server, prompt("R1 sees 12 objects. " * CONTEXT))
    assert caught.value.code == "too_large"
