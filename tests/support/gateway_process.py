"""A gateway as users run it: a process of its own, asked over HTTP."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class GatewayProcess:
    """What a process has told of itself."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.told: list[str] = []
        """The names of the events in its log so far."""
        self.port = int(self.event("gateway_up")["http_port"])

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/v1"

    def event(self, name: str) -> dict[str, Any]:
        """The next line of its log with this name."""
        assert self._process.stderr is not None
        for line in self._process.stderr:
            told: dict[str, Any] = json.loads(line) if line.startswith("{") else {"event": line}
            self.told.append(told["event"])
            if told["event"] == name:
                return told
        raise AssertionError(f"the gateway ended without {name}: {self.told}")


@contextmanager
def gateway_process(**settings: str) -> Iterator[GatewayProcess]:
    """A gateway without a swarm; `LLM_URL` and the like name its settings."""
    kept = {name: v for name, v in os.environ.items() if not name.startswith("COADAPT_")}
    ours = {"ROUTER": "tcp/127.0.0.1:1", "METRICS_PORT": "0", "LLM_HTTP_PORT": "0", **settings}
    process = subprocess.Popen(
        [sys.executable, "-m", "llm_gateway"],
        env=kept | {f"COADAPT_{name}": value for name, value in ours.items()},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield GatewayProcess(process)
    finally:
        process.terminate()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
