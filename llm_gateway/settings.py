"""Settings of the LLM gateway."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated

import msgspec

from swarm.defaults import LLM_PORT
from swarm.errors import SettingError
from swarm.http.access import token_of
from swarm.http.hosts import HostNames
from swarm.process import SwarmSettings
from swarm.secret_files import secret_of
from swarm.settings import Name, Port, Seconds, Secret, load, shown

_KEY = re.compile(r"[\x21-\x7e]{1,4096}")


class GatewaySettings(SwarmSettings, frozen=True, kw_only=True):
    """How a site's models are asked. Field `llm_url` is read from `COADAPT_LLM_URL`."""

    llm_backend: Name = "none"
    llm_url: str = ""
    """Of the OpenAI-compatible server, up to and including its version (`http://host:8000/v1`)."""
    llm_model: str = ""
    """`openai`: the model's name at the server; `llamacpp`: path of a GGUF file, or the name of a
    model that a package carries. Empty takes the server's first, or the package's own."""
    llm_trained: bool = False
    """`llamacpp`: the package's own model decides with what it has learned of the short prompt."""
    llm_api_key: Secret = ""
    llm_api_key_file: str = ""
    """A file that holds the key instead."""
    llm_parallel: Annotated[int, msgspec.Meta(ge=1, le=256)] = 8
    """Prompts that the model works on at a time."""
    llm_threads: Annotated[int, msgspec.Meta(ge=0, le=256)] = 0
    """Of the embedded model; 0 takes what the machine has."""
    llm_context: Annotated[int, msgspec.Meta(ge=256, le=1 << 20)] = 4096
    """Tokens that the embedded model keeps for each prompt and its answer."""
    llm_queue: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 128
    """Model calls that wait at most."""
    llm_per_client: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 8
    """Of them, of one client."""
    llm_window_ms: Annotated[float, msgspec.Meta(ge=0, le=1000)] | None = None
    """How long the first jobs after a rest wait for each other; 0 starts each at once. None: 10
    where the model is embedded, which reads together what begins alike; servers batch anyway."""
    llm_cache: str = ""
    """SQLite file of the cache; empty keeps answers in memory only."""
    llm_cache_ttl_s: Annotated[float, msgspec.Meta(gt=0, le=30 * 86_400)] = 300.0
    llm_cache_entries: Annotated[int, msgspec.Meta(ge=1, le=1_000_000)] = 10_000
    llm_http_host: str = "127.0.0.1"
    llm_http_port: Port = LLM_PORT
    """Where the OpenAI-compatible endpoint answers; 0 takes any free port."""
    llm_http_token: Secret = ""
    """Bearer token that clients must show; needed to answer off this host."""
    llm_http_token_file: str = ""
    """A file that holds the token instead."""
    llm_http_names: HostNames = ()
    """Names, beside localhost and addresses, that clients may ask for."""
    llm_breaker_failures: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 5
    """Failed calls in a row after which the model is left alone ..."""
    llm_breaker_s: Seconds = 10.0
    """... for this long."""
    llm_deadline_max_s: Annotated[float, msgspec.Meta(gt=0, le=600)] = 120.0
    """Nobody is waited with any longer, whatever was asked for."""

    def window_ms(self) -> float:
        """`llm_window_ms`, or what suits the back end."""
        if self.llm_window_ms is not None:
            return self.llm_window_ms
        return 10.0 if self.llm_backend == "llamacpp" else 0.0

    def __repr__(self) -> str:
        return shown(self)


def load_settings(environment: Mapping[str, str] | None = None) -> GatewaySettings:
    """The settings from the environment and the TOML file, with the key from its file.

    Raises SettingError that names the variable, its value (never a key or token) and what is
    allowed.
    """
    settings = load(GatewaySettings, environment)
    key_file, token_file = settings.llm_api_key_file, settings.llm_http_token_file
    key = secret_of("COADAPT_LLM_API_KEY", settings.llm_api_key, key_file, kind="key")
    if key and not _KEY.fullmatch(key):
        wrong = f"_FILE = {key_file!r} holds no key" if key_file else " is not valid"
        raise SettingError(f"COADAPT_LLM_API_KEY{wrong}; {_ALLOWED}")
    token = token_of("COADAPT_LLM_HTTP_TOKEN", settings.llm_http_token, token_file)
    return msgspec.structs.replace(settings, llm_api_key=key, llm_http_token=token)


_ALLOWED = "it must be 1 to 4096 printable ASCII characters without spaces"
