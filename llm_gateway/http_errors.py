"""Refusals of the HTTP endpoint, in OpenAI's shape."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
from starlette.responses import Response

from llm_gateway.http_messages import ErrorBody, ErrorDetail
from llm_gateway.model import PromptRefusedError
from swarm.errors import GatewayCode, GatewayError

STATUSES: dict[GatewayCode, int] = {
    "expired": 504,
    "busy": 429,
    "too_large": 413,
    "unavailable": 503,
    "failed": 502,
    "invalid": 502,
}
RETRY_AFTER_S = 1
"""The gateway knows no better: its breaker tries the model again by itself."""
_TYPES = {401: "authentication_error", 404: "not_found_error", 429: "rate_limit_error"}


class HttpError(Exception):
    """A request that gets an error status."""

    def __init__(
        self,
        status: int,
        message: str,
        *,
        code: str | None = None,
        param: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.message = message
        self.code = code
        self.param = param
        self.headers = headers

    def body(self) -> bytes:
        """OpenAI's error body."""
        kind = "invalid_request_error" if self.status < 500 else "server_error"
        error = ErrorDetail(
            message=self.message,
            type=_TYPES.get(self.status, kind),
            param=self.param,
            code=self.code,
        )
        return msgspec.json.encode(ErrorBody(error))

    def response(self) -> Response:
        """The whole answer."""
        return Response(self.body(), self.status, self.headers, "application/json")


def of_gateway(error: GatewayError) -> HttpError:
    """What a client is told where the gateway has no answer."""
    status = 400 if isinstance(error, PromptRefusedError) else STATUSES[error.code]
    later = {"Retry-After": str(RETRY_AFTER_S)} if status in (429, 503) else None
    return HttpError(status, str(error), code=error.code, headers=later)
