"""Cycles without a valid decision in time, whatever the language model does.

A swarm of six robots in network namespaces with policy `llm` and a control cycle of one second, a
quarter of the time each with: the embedded model; a model server that answers after 30 s; one that
fails; no gateway at all. From the ego's journal: a cycle is missed when its decision is not valid,
took longer than the period, or was left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from deploy.paths import journal_path
from deploy.ports import LOCALHOST
from deploy.spec import EMBEDDED, SwarmSpec, factory_robots, make_spec
from research.benchmarks.intervals import share_interval
from research.benchmarks.live import READY_S, live_swarm
from research.benchmarks.report import write_report
from swarm.errors import DeployError

SECONDS = 120.0
"""Of all phases."""
SLOW_S = 30.0
COUNTS = ("missed", "cycles")
SWARM = "bench-deadline"
MODEL = "bench"


@contextmanager
def model_server(wait_s: float, status: int) -> Iterator[str]:
    """The URL of a server whose completions come after a wait, with that status."""
    closing = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self._reply(200, {"object": "list", "data": [{"id": MODEL, "object": "model"}]})

        def do_POST(self) -> None:
            self.rfile.read(int(self.headers.get("content-length", 0)))
            closing.wait(wait_s)
            message = {"role": "assistant", "content": "{}"}
            choice = {"index": 0, "message": message, "finish_reason": "stop"}
            self._reply(status, {"id": "1", "model": MODEL, "choices": [choice]})

        def _reply(self, code: int, body: dict[str, Any]) -> None:
            data = json.dumps(body).encode()
            self.send_response(code)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer((LOCALHOST, 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{LOCALHOST}:{server.server_port}/v1"
    finally:
        closing.set()
        server.shutdown()
        server.server_close()


def run_swarm(llm: str, seconds: float) -> list[dict[str, Any]]:
    """The journal's lines of a swarm that was ready for so many seconds."""
    values: dict[str, Any] = {"policy": "llm", "llm": llm, "link_bps": None}
    if llm.startswith("http"):
        values["llm_model"] = MODEL
    with live_swarm(SWARM, {}, **values) as state:
        _await_gateway(state.spec)
        begun_ns = time.time_ns()
        time.sleep(seconds)
        return [line for line in _lines(state.spec) if line["started_ns"] >= begun_ns]


def _await_gateway(spec: SwarmSpec) -> None:
    """Waits until the ego has a gateway to ask, where there is one: a model takes a while to
    load. Raises DeployError when it does not come."""
    deadline = time.monotonic() + READY_S
    while spec.llm and not list(_lines(spec))[-1]["advice"]["gateway"]:
        if time.monotonic() > deadline:
            raise DeployError(f"no LLM gateway within {READY_S} s: its log says why")
        time.sleep(1.0)


def _lines(spec: SwarmSpec) -> Iterator[dict[str, Any]]:
    for line in Path(journal_path(spec, spec.var_dir)).read_text().splitlines():
        if line.endswith("}"):
            yield json.loads(line)


def phase(name: str, llm: str, seconds: float) -> dict[str, Any]:
    """One phase's figures."""
    lines = run_swarm(llm, seconds)
    period_s = make_spec(swarm=SWARM, robots=factory_robots(6)).period_s
    span_s = (lines[-1]["started_ns"] - lines[0]["started_ns"]) * 1e-9
    left_out = max(0, round(span_s / period_s) + 1 - len(lines))
    invalid = sum(not line["decision"]["valid"] for line in lines)
    late = sum(line["latency"]["cycle_ms"] > period_s * 1e3 for line in lines)
    answers = [line["advice"]["answer"] for line in lines]
    figures = {
        "phase": name,
        "cycles": len(lines) + left_out,
        "missed": left_out + invalid + late,
        "left_out": left_out,
        "invalid": invalid,
        "late": late,
        "cycle_ms_max": max(line["latency"]["cycle_ms"] for line in lines),
        "sources": dict(Counter(line["decision"]["source"] for line in lines)),
        "outcomes": dict(Counter(answer["outcome"] for answer in answers if answer)),
        "ended": dict(Counter(e for line in lines if (e := line["advice"]["ended"]))),
    }
    print(f"deadline: {figures}", flush=True)
    return figures


def main() -> int:
    """Measures and writes deadline.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds",
        type=float,
        default=SECONDS,
        help="of all phases together (default: %(default)s)",
    )
    each_s = parser.parse_args().seconds / 4
    rows = [phase("answering", EMBEDDED, each_s)]
    with model_server(SLOW_S, 200) as url:
        rows.append(phase("slow", url, each_s))
    with model_server(0.0, 500) as url:
        rows.append(phase("failing", url, each_s))
    rows.append(phase("absent", "", each_s))
    figures = {
        "cycles": sum(row["cycles"] for row in rows),
        "missed": sum(row["missed"] for row in rows),
        "missed_ratio_interval": share_interval(*(sum(r[key] for r in rows) for key in COUNTS)),
        "rows": rows,
    }
    print(f"deadline: {figures['missed']} of {figures['cycles']} cycles missed")
    write_report("deadline", figures, {})
    return 0


if __name__ == "__main__":
    sys.exit(main())
