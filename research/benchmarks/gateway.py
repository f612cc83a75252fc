"""What the LLM gateway costs: cache hits, its overhead on misses beside LiteLLM's, shared calls.

The gateway process itself with a Zenoh router, in front of a model server that answers after a
fixed time; 50 egos with one request under way each. Overhead is a request's time less what the
model server itself needed, so it holds both connections and the client. LiteLLM's proxy stands in
the gateway's place in the same run, with the same HTTP client; `direct` is that client without
anything between. With `--repeats` the embedded model, too, where it is installed.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
import urllib.request
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import aiohttp
import numpy as np
from prometheus_client import CollectorRegistry

from deploy.progress import say
from llm_gateway.backends.none import NoBackend
from llm_gateway.cache import Cache
from llm_gateway.gateway import Gateway
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Job, Prompt
from research.benchmarks.fixed_model import MODEL
from research.benchmarks.litellm_proxy import install, litellm
from research.benchmarks.load import Ask, fresh_scene, in_turn, over_http, over_zenoh
from research.benchmarks.processes import free_port, process
from research.benchmarks.report import write_report
from swarm.errors import SettingError, TransportError
from swarm.log import make_logger
from swarm.messages import ChatMessage, LlmTokens
from swarm.session import Session

EGOS = 50
MODEL_S = 1.0
SAME = 100
SWARM = "bench"
START_S = 30.0
LOG = make_logger("bench", level="error")


async def exact_hits_ms(count: int) -> list[float]:
    """Time of the gateway's core for a prompt that it knows, with the cache's file on disk."""
    prompt = Prompt((ChatMessage("user", fresh_scene()),), '{"type":"object"}')
    with TemporaryDirectory() as place:
        metrics = GatewayMetrics(CollectorRegistry())
        cache = Cache(Path(place) / "cache.sqlite", metrics, LOG)
        gateway = Gateway(NoBackend(), cache, metrics, LOG)
        await gateway.start()
        cache.put(prompt.key(gateway.model), "", gateway.model, "{}", LlmTokens())
        found = []
        for _ in range(count):
            job = Job(prompt, "R1", time.monotonic() + 10)
            begun = time.perf_counter()
            done = await gateway.complete(job)
            found.append((time.perf_counter() - begun) * 1e3)
            assert done.hit == "exact"
        await gateway.close()
    return found


@asynccontextmanager
async def site(stack: ExitStack) -> AsyncIterator[tuple[Session, str, str]]:
    """A session, the gateway's HTTP address and the model server's."""
    ports = {name: free_port() for name in ("router", "http", "model")}
    router = f"tcp/127.0.0.1:{ports['router']}"
    model = f"http://127.0.0.1:{ports['model']}"
    stack.enter_context(
        process("research.benchmarks.fixed_model", str(ports["model"]), str(MODEL_S))
    )
    stack.enter_context(process("swarm.router", "--port", str(ports["router"])))
    wait_for(f"{model}/v1/models")
    stack.enter_context(
        process(
            "llm_gateway",
            COADAPT_SWARM=SWARM,
            COADAPT_ROUTER=router,
            COADAPT_METRICS_PORT="0",
            COADAPT_LOG_LEVEL="error",
            COADAPT_LLM_BACKEND="openai",
            COADAPT_LLM_URL=model,
            COADAPT_LLM_MODEL=MODEL,
            COADAPT_LLM_PARALLEL="64",
            COADAPT_LLM_HTTP_PORT=str(ports["http"]),
        )
    )
    http = f"http://127.0.0.1:{ports['http']}"
    wait_for(f"{http}/healthz")
    session = stack.enter_context(Session(router, SWARM, timeout_s=START_S))
    await until_served(over_zenoh(session))
    yield session, http, model


def wait_for(url: str) -> None:
    """Until a server answers there."""
    deadline = time.monotonic() + START_S
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5):
                return
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


async def until_served(ask: Ask) -> None:
    """Until the gateway's queryable has reached the session."""
    deadline = time.monotonic() + START_S
    while True:
        try:
            await ask(0, fresh_scene())
            return
        except TransportError:
            if time.monotonic() > deadline:
                raise
            await asyncio.sleep(0.1)


async def known_ms(ask: Ask, count: int) -> list[float]:
    """Times of a request whose answer the cache has."""
    scene = fresh_scene()
    await ask(0, scene)
    found = []
    for _ in range(count):
        begun = time.perf_counter()
        answer = await ask(0, scene)
        found.append((time.perf_counter() - begun) * 1e3)
        assert answer["source"] == "cache"
    return found


async def calls_of_equals(ask: Ask, direct: Ask) -> int:
    """Model calls that many equal requests at a time make; the model server counts."""
    before = (await direct(0, fresh_scene()))["calls"]
    scene = fresh_scene()
    await asyncio.gather(*(ask(number, scene) for number in range(SAME)))
    return int((await direct(0, fresh_scene()))["calls"] - before - 1)


async def beside_litellm(
    client: aiohttp.ClientSession, model: str, rounds: int
) -> tuple[list[float] | None, str]:
    """Overhead of LiteLLM's proxy, or None and why."""
    missing = await asyncio.to_thread(install)
    if missing:
        return None, missing
    try:
        with litellm(free_port(), model) as url:
            return await in_turn(over_http(client, url), EGOS, rounds, MODEL_S), ""
    except RuntimeError as error:
        return None, str(error)


async def measure(rounds: int, hits: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures and samples of all that needs no real model."""
    samples: dict[str, Any] = {"exact_hit_ms": await exact_hits_ms(hits)}
    with ExitStack() as stack:
        connections = aiohttp.TCPConnector(limit=0)
        async with (
            site(stack) as (session, http, model),
            aiohttp.ClientSession(connector=connections) as client,
        ):
            direct = over_http(client, model)
            zenoh = over_zenoh(session)
            samples["zenoh_hit_ms"] = await known_ms(zenoh, hits)
            calls = await calls_of_equals(zenoh, direct)
            ways = {"zenoh": zenoh, "http": over_http(client, http), "direct": direct}
            for name, ask in ways.items():
                say(f"{EGOS} egos, {name}")
                samples[f"{name}_overhead_ms"] = await in_turn(ask, EGOS, rounds, MODEL_S)
            say(f"{EGOS} egos, litellm")
            theirs, why = await beside_litellm(client, model, rounds)
            samples["litellm_overhead_ms"] = theirs
    figures = {
        "exact_hit_p99_ms": percentile(samples["exact_hit_ms"], 99),
        "zenoh_hit_p99_ms": percentile(samples["zenoh_hit_ms"], 99),
        "miss_overhead_p99_ms": percentile(samples["zenoh_overhead_ms"], 99),
        "miss_overhead_p50_ms": percentile(samples["zenoh_overhead_ms"], 50),
        "miss_overhead_http_p50_ms": percentile(samples["http_overhead_ms"], 50),
        "miss_overhead_http_p99_ms": percentile(samples["http_overhead_ms"], 99),
        "direct_p50_ms": percentile(samples["direct_overhead_ms"], 50),
        "direct_p99_ms": percentile(samples["direct_overhead_ms"], 99),
        **{
            f"ratio_litellm_p{q}": of_theirs(samples["http_overhead_ms"], theirs, q)
            for q in (50, 99)
        },
        "litellm_p50_ms": percentile(theirs, 50),
        "litellm_p99_ms": percentile(theirs, 99),
        "litellm_missing": why,
        "single_flight_calls": calls,
    }
    return figures, samples


def percentile(samples: list[float] | None, share: float) -> float | None:
    """Rounded to microseconds; None of nothing."""
    return None if samples is None else round(float(np.percentile(samples, share)), 3)


def of_theirs(ours: list[float], theirs: list[float] | None, share: float) -> float | None:
    """A percentile of ours as a part of that of theirs; None without theirs."""
    if theirs is None:
        return None
    return round(float(np.percentile(ours, share) / np.percentile(theirs, share)), 4)


async def with_model(repeats: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures and samples of the embedded model; figures of None and why without it."""
    from llm_gateway.backends.llamacpp.models import find_model, runtime_installed

    nothing = dict.fromkeys(("batch_speedup", "prefix_ratio", "valid_constrained"))
    try:
        model = find_model("smollm2-135m")
    except SettingError as error:
        return nothing | {"embedded_missing": str(error)}, {}
    if repeats < 1:
        return nothing | {"embedded_missing": "not asked for: embedded.json has it"}, {}
    if not runtime_installed():
        return nothing | {"embedded_missing": "llama-cpp-python is not installed"}, {}
    from research.benchmarks.gateway_embedded import embedded

    say("the embedded model")
    figures, samples = await embedded(model, repeats)
    return figures | {"embedded_missing": ""}, samples


def main() -> int:
    """Measures and writes gateway.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=8, help="requests of each ego")
    parser.add_argument("--hits", type=int, default=2000)
    parser.add_argument(
        "--repeats", type=int, default=0, help="with the embedded model, too: that many"
    )
    args = parser.parse_args()
    figures, samples = asyncio.run(measure(args.rounds, args.hits))
    more, samples["embedded"] = asyncio.run(with_model(args.repeats))
    figures |= more
    print("gateway: " + ", ".join(f"{name} {value}" for name, value in figures.items() if value))
    write_report("gateway", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
