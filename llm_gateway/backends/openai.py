"""The back end `openai`: any server that speaks OpenAI's chat completions."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from llm_gateway.backends.base import BackendKind
from llm_gateway.backends.openai_stream import StreamedReply
from llm_gateway.backends.openai_wire import (
    Dialect,
    Form,
    adapt,
    read_models,
    read_reply,
    refusal,
    refuses_form,
    request_body,
)
from llm_gateway.model import Hear, Prompt, Reply
from llm_gateway.settings import GatewaySettings
from swarm.errors import GatewayError, SettingError
from swarm.log import Logger

if TYPE_CHECKING:
    import aiohttp

    from llm_gateway.backends.openai_reach import Reach

MAX_ANSWER_BYTES = 4_000_000
CONNECT_S = 5.0
START_S = 3.0
"""How long the start waits for a server's list of models."""
_IDLE_S = 4.0
"""Shorter than the 5 s after which uvicorn, which many servers use, closes an idle connection:
a request must not go out on one that is just being closed."""
_MAX_NAME = 200


class _Said(NamedTuple):
    """A server's answer; with `reply` where it came as a stream."""

    status: int
    headers: dict[str, str]
    raw: bytes
    reply: Reply | None


class OpenAi:
    """Asks a server. An empty model name takes the first that the server lists.

    Raises SettingError for a URL that is none or holds a user or a query, and for a key that
    cannot stand in a header; the key is in no message.
    """

    name = "openai"

    def __init__(self, base_url: str, model: str, api_key: str, parallel: int, log: Logger) -> None:
        self._url = _checked(base_url)
        if not re.fullmatch(r"[!-~]*", api_key):
            raise SettingError(
                "the API key is not valid; it must be printable ASCII without spaces"
            )
        self._key = api_key
        self._wanted = model
        self._found = ""
        self._parallel = parallel
        self._log = log
        self._dialect = Dialect()
        self._session: aiohttp.ClientSession | None = None
        self._reach: Reach | None = None

    def __repr__(self) -> str:
        return f"OpenAi({self._url!r}, {self.model!r})"

    @property
    def model(self) -> str:
        """As configured or listed; `unknown` until a server has said."""
        return self._wanted or self._found or "unknown"

    @property
    def parallel(self) -> int:
        """As configured; servers queue what is too much for them."""
        return self._parallel

    @property
    def trouble(self) -> str:
        """Why the server cannot be reached."""
        return self._reach.trouble if self._reach else ""

    async def start(self) -> None:
        """Asks the server which models it has; one that does not answer is asked again later."""
        import aiohttp

        from llm_gateway.backends.openai_reach import Reach

        self._reach = Reach(self._url, self._probe, self._log)
        headers = {"Content-Type": "application/json", "Accept-Encoding": "identity"}
        if self._key:
            headers["Authorization"] = f"Bearer {self._key}"
        self._session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0, keepalive_timeout=_IDLE_S),
            # The whole call is bounded by its deadline.
            timeout=aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_S),
            headers=headers,
            cookie_jar=aiohttp.DummyCookieJar(),
        )
        try:
            async with asyncio.timeout(START_S):
                await self._ask_models()
        except (GatewayError, TimeoutError) as error:
            if not self.trouble:
                self._log.warning("llm_server_not_ready", url=self._url, error=str(error))
        else:
            self._log.info("llm_server", url=self._url, model=self.model)

    async def complete(self, prompt: Prompt, timeout_s: float, hear: Hear | None = None) -> Reply:
        """See `Backend.complete`; `timeout_s` bounds everything, however slowly a body drips."""
        try:
            async with asyncio.timeout(timeout_s):
                if not self._wanted and not self._found:
                    await self._ask_models()
                return await self._complete(prompt, hear)
        except TimeoutError:
            raise GatewayError(
                "expired", f"{self._url} did not answer within {timeout_s:.1f} s"
            ) from None

    async def close(self) -> None:
        """Closes all connections."""
        if self._reach is not None:
            await self._reach.close()
        session, self._session = self._session, None
        if session is not None:
            await session.close()

    async def _probe(self) -> None:
        with contextlib.suppress(GatewayError, TimeoutError):
            async with asyncio.timeout(START_S):
                await self._send("GET", "/models")

    async def _ask_models(self) -> None:
        said = await self._send("GET", "/models")
        if said.status != 200:
            raise refusal(said.status, said.headers, said.raw, self._url)
        names = [
            n
            for n in read_models(said.raw, self._url)
            if 0 < len(n) <= _MAX_NAME and n.isprintable()
        ]
        if not names and not self._wanted:
            raise GatewayError("unavailable", f"{self._url} lists no models")
        if self._wanted and self._wanted not in names:
            self._log.warning("llm_model_not_listed", model=self._wanted, listed=names[:10])
        self._found = names[0] if names else ""

    async def _complete(self, prompt: Prompt, hear: Hear | None) -> Reply:
        """Asks in the best form that the server may understand, and worse ones after refusals."""
        for form in self._dialect.forms(time.monotonic()):
            said = await self._ask(prompt, form, hear)
            if said.status == 200:
                reply = said.reply or read_reply(said.raw, self._url)
                if prompt.schema:
                    self._learn(form)
                return reply
            if not prompt.schema or not refuses_form(said.status, said.raw):
                break
        if said.status == 404:
            # The server may have been started again with another model.
            self._found = ""
        raise refusal(said.status, said.headers, said.raw, self._url)

    def _learn(self, form: Form) -> None:
        before = self._dialect.form
        self._dialect.learn(form, time.monotonic())
        if self._dialect.form != before:
            self._log.info("llm_form", form=self._dialect.form, before=before)

    async def _ask(self, prompt: Prompt, form: Form, hear: Hear | None) -> _Said:
        stream = hear is not None
        while True:
            used = replace(self._dialect)
            body = request_body(prompt, self.model, form, used, stream=stream)
            said = await self._send("POST", "/chat/completions", body, hear)
            if said.status == 200 or not adapt(self._dialect, used, prompt, said.status, said.raw):
                return said

    async def _send(
        self, method: str, path: str, body: bytes | None = None, hear: Hear | None = None
    ) -> _Said:
        """What the server says, the body bounded. Errors are raised without their causes, which
        hold the request's headers."""
        import aiohttp

        from llm_gateway.backends.openai_reach import why_lost

        if self._session is None or self._reach is None:
            raise GatewayError("unavailable", f"the connection to {self._url} is closed")
        try:
            async with self._session.request(
                method, self._url + path, data=body, allow_redirects=False
            ) as response:
                self._reach.found()
                raw = bytearray()
                streamed = StreamedReply(self._url) if hear and _is_stream(response) else None
                async for chunk in response.content.iter_any():
                    raw += chunk
                    if hear and streamed and (words := streamed.take(chunk)):
                        hear(words)
                    if len(raw) > MAX_ANSWER_BYTES:
                        raise GatewayError(
                            "failed", f"{self._url} answers more than {MAX_ANSWER_BYTES} bytes"
                        )
                later = {"Retry-After": response.headers.get("Retry-After", "")}
                body_read = bytes(raw) if response.status == 200 else self._hide(bytes(raw))
                reply = streamed.reply() if streamed else None
                return _Said(response.status, later, body_read, reply)
        except aiohttp.ClientConnectionError as error:
            why = why_lost(error, self._url, self._said(error))
            if isinstance(error, aiohttp.ClientConnectorError | aiohttp.ServerTimeoutError):
                self._reach.lost(why)
            else:
                self._reach.broke_off(why)
            raise GatewayError("unavailable", f"{self._url} cannot be reached: {why}") from None
        except aiohttp.ClientError as error:
            why = f"{self._url} does not speak HTTP well: {self._said(error)}"
            raise GatewayError("failed", why) from None

    def _hide(self, raw: bytes) -> bytes:
        """A refusal without the key, should the server quote it."""
        return raw.replace(self._key.encode(), b"(key)") if self._key else raw

    def _said(self, error: Exception) -> str:
        text = self._hide(" ".join(str(error).split()).encode()).decode()
        return text[:200] or type(error).__name__


def _is_stream(response: aiohttp.ClientResponse) -> bool:
    return response.status == 200 and response.content_type == "text/event-stream"


def _checked(url: str) -> str:
    """The URL that paths are appended to: of a bare host, its /v1."""
    if re.search("[@?#]", url):
        # The value may hold a secret.
        raise SettingError(
            "the address of the model server must hold no user, query or fragment; "
            "give the API key by itself"
        )
    try:
        parts = urlsplit(url)
        valid = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        valid = False
    if not valid or not re.fullmatch("[!-~]+", url):
        raise SettingError(
            f"{url!r} is no address of a model server; it must be like http://127.0.0.1:8000/v1"
        )
    return url.rstrip("/") if parts.path.strip("/") else f"{parts.scheme}://{parts.netloc}/v1"


def _make(settings: GatewaySettings, log: Logger) -> OpenAi:
    try:
        return OpenAi(
            settings.llm_url, settings.llm_model, settings.llm_api_key, settings.llm_parallel, log
        )
    except SettingError as error:
        raise SettingError(f"COADAPT_LLM_URL: {error}") from error


BACKENDS = (BackendKind("openai", _make),)
