"""Who may ask the HTTP endpoint, and what is counted of each request."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from llm_gateway.http_errors import STATUSES, HttpError
from llm_gateway.http_operations import API
from swarm.http.access import Access
from swarm.log import Logger
from swarm.metrics import start_at_zero

ANOTHER_NAME = (
    "this gateway answers under this host's own addresses, as localhost, and under the names that "
    "COADAPT_LLM_HTTP_NAMES lists"
)
_OPEN_PATHS = API.open_paths


class Gate:
    """Around everything: checks the name that was asked for and the token, counts, and logs what
    fails."""

    def __init__(
        self, app: ASGIApp, access: Access, registry: CollectorRegistry, log: Logger
    ) -> None:
        self._app = app
        self._access = access
        self._log = log
        self._requests = Counter(
            "coadapt_llm_http_requests_total",
            "Requests at the HTTP endpoint by status; 499 where the client left first.",
            ["status"],
            registry=registry,
        )
        start_at_zero(self._requests, ("200", "499", *map(str, set(STATUSES.values()))))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._requests.labels(message["status"]).inc()
            await send(message)

        try:
            await (self._refusal(scope) or self._app)(scope, receive, counted)
        except Exception:
            path = scope["path"][:200]
            self._log.error("llm_http_failed", method=scope["method"], path=path, exc_info=True)

    def _refusal(self, scope: Scope) -> Response | None:
        open_path = scope["path"] in _OPEN_PATHS
        match self._access.refusal(Headers(scope=scope), without_token=open_path):
            case "name":
                return HttpError(403, ANOTHER_NAME, code="host").response()
            case "token":
                return HttpError(
                    401,
                    "this needs the header Authorization: Bearer and the gateway's token",
                    code="invalid_api_key",
                    headers={"WWW-Authenticate": "Bearer"},
                ).response()
        return None
