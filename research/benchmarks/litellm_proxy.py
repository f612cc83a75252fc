"""LiteLLM's proxy to measure beside the gateway, in a virtual environment of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deploy.progress import say
from research.benchmarks.fixed_model import MODEL

PLACE = Path("build/litellm")
START_S = 120.0
INSTALL_S = 900.0


def install() -> str:
    """Makes the environment if need be. Returns why it cannot be had; empty when it is there."""
    if (PLACE / "bin/litellm").exists():
        return ""
    say(f"installing litellm[proxy] into {PLACE}")
    try:
        for command in (
            [sys.executable, "-m", "venv", str(PLACE)],
            [str(PLACE / "bin/pip"), "install", "--quiet", "litellm[proxy]"],
        ):
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=INSTALL_S)
    except subprocess.CalledProcessError as error:
        return f"litellm[proxy] cannot be installed: {error.stderr.strip()[-300:]}"
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"litellm[proxy] cannot be installed: {error}"
    return ""


@contextmanager
def litellm(port: int, model_url: str) -> Iterator[str]:
    """Its address, in front of one model server. Raises RuntimeError when it does not start."""
    config = PLACE / "config.yaml"
    config.write_text(
        "model_list:\n"
        f"  - model_name: {MODEL}\n"
        f"    litellm_params: {{model: openai/{MODEL}, api_base: {model_url}/v1, api_key: none}}\n"
        "litellm_settings: {telemetry: false, num_retries: 0}\n"
    )
    command = [str(PLACE / "bin/litellm"), "--config", str(config), "--num_workers", "1"]
    environment = os.environ | {
        # Its table of prices is fetched from elsewhere otherwise.
        "LITELLM_LOCAL_MODEL_COST_MAP": "True",
        # Like ours, it is open to this host's clients.
        "LITELLM_DANGEROUSLY_PERMIT_WEAK_OR_UNSET_MASTER_KEY": "true",
        "LITELLM_LOG": "ERROR",
        "LITELLM_MODE": "PRODUCTION",
    }
    with (PLACE / "proxy.log").open("wb") as log:
        process = subprocess.Popen(
            [*command, "--host", "127.0.0.1", "--port", str(port)],
            stdout=log,
            stderr=log,
            env=environment,
        )
    url = f"http://127.0.0.1:{port}"
    try:
        _wait(process, url)
        yield url
    finally:
        process.terminate()
        process.wait()


def _wait(process: subprocess.Popen[bytes], url: str) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            with urllib.request.urlopen(f"{url}/health/liveliness", timeout=5):
                return
        except OSError:
            time.sleep(0.5)
    raise RuntimeError(f"litellm's proxy did not start; {PLACE / 'proxy.log'} says why")
