"""Names that a swarm is started with, checked before anything is started."""

from __future__ import annotations

import os
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from deploy.environments import API_KEY, API_KEY_FILE
from deploy.progress import say
from deploy.spec import EMBEDDED, SwarmSpec
from swarm.errors import DeployError, GatewayError, TransportError
from swarm.http.asking import ask

ASK_S = 3.0
MAX_LIST_BYTES = 1_000_000
SHOWN = 10
"""So many models stand in a message."""


def check_choices(spec: SwarmSpec) -> None:
    """Raises a CoAdaptError that names a policy, world, scenario or model that cannot be had, and
    what is allowed."""
    # Imported here: the other commands need no arrays.
    from ego_agent.plan.policies.registry import make_policy
    from perception.fusion.algorithms import all_fusions
    from worlds.registry import open_world, world_kind

    make_policy(spec.policy, all_fusions())
    if not world_kind(spec.world).data:
        open_world(
            spec.world,
            robots=spec.room(),
            seed=spec.seed,
            rings=spec.rings,
            scenario=spec.scenario,
        )
    if spec.llm == EMBEDDED:
        _check_embedded(spec.llm_model, spec.runtime)
    elif spec.llm and spec.llm_model:
        _check_listed(spec.llm, spec.llm_model)


def _check_embedded(name: str, runtime: str) -> None:
    from llm_gateway.backends.llamacpp.models import DEFAULT_MODEL, PACKAGES, find_model

    if runtime == "netns":
        find_model(name or DEFAULT_MODEL)
    elif name and name not in PACKAGES:
        # The image brings its models; files of the host are not in it.
        raise DeployError(
            f"model {name!r} is not in the image of the LLM gateway; allowed: {', '.join(PACKAGES)}"
        )


def _check_listed(url: str, name: str) -> None:
    """A server that does not answer now may do so later: that is told and no error."""
    from llm_gateway.backends.openai_wire import read_models

    base = url.rstrip("/") if urlsplit(url).path.strip("/") else f"{url.rstrip('/')}/v1"
    key = _api_key()
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    try:
        status, raw = ask(
            f"{base}/models", headers=headers, timeout_s=ASK_S, most_bytes=MAX_LIST_BYTES
        )
        if status != HTTPStatus.OK:
            raise TransportError(f"HTTP status {status}")
        listed = read_models(raw, base)
    except (TransportError, GatewayError) as reason:
        say(f"{base} lists no models yet ({reason}): {name!r} is not checked")
        return
    # Ollama lists `name:tag`, and takes `name` for `name:latest`.
    if not any(found == name or found.startswith(f"{name}:") for found in listed):
        raise DeployError(
            f"model {name!r} is not served by {base}; it lists: {', '.join(listed[:SHOWN])}"
        )


def _api_key() -> str:
    """As the gateway reads it. Raises DeployError where its file cannot be read."""
    if file := os.environ.get(API_KEY_FILE):
        try:
            return Path(file).read_text().strip()
        except OSError as error:
            raise DeployError(f"{API_KEY_FILE} = {file!r} cannot be read: {error}") from error
    return os.environ.get(API_KEY, "")
