"""The operations of the HTTP endpoint, which both its routes and its OpenAPI document are of."""

from __future__ import annotations

import msgspec

from llm_gateway.http_headers import HEADERS
from llm_gateway.http_messages import (
    ChatChunk,
    ChatCompletion,
    ChatRequest,
    ErrorBody,
    Model,
    Models,
)
from swarm.http.openapi import Api, Health, Operation
from swarm.messages import Intent, WishRequest

HEALTH_PATH = "/healthz"
DONE = "[DONE]"
"""What the last event of a stream says."""
_BODY = (408, 413, 415)
"""What a body may be refused with."""
_GATEWAY = (429, 502, 503, 504)
"""What the gateway may refuse a question with."""

API = Api(
    title="CoAdapt Edge: LLM gateway",
    version="1.0.0",
    description="OpenAI's chat completions, and wishes in plain words, for clients that are no "
    "part of the swarm.",
    operations=(
        Operation(
            "POST",
            "/v1/chat/completions",
            "createChatCompletion",
            "Asks the model; a request with `stream` is answered by events",
            200,
            ChatCompletion,
            ChatRequest,
            (404, *_BODY, *_GATEWAY),
            headers=HEADERS,
            events=(ChatChunk, ErrorBody),
            last_event=DONE,
        ),
        Operation(
            "POST",
            "/v1/wishes",
            "readWish",
            "What a wish in plain words means; nothing of it is in force",
            200,
            Intent,
            WishRequest,
            (*_BODY, *_GATEWAY),
        ),
        Operation("GET", "/v1/models", "listModels", "The model that answers", 200, Models),
        # Names of models have slashes in them.
        Operation(
            "GET",
            "/v1/models/{name:path}",
            "retrieveModel",
            "The model that answers, by its name",
            200,
            Model,
            errors=(404,),
        ),
        Operation(
            "GET",
            HEALTH_PATH,
            "getHealth",
            "Whether the gateway answers",
            200,
            Health,
            without_token=True,
        ),
    ),
    error=ErrorBody,
    refusals=(400, 401, 403, 500),
    in_paths={"name": msgspec.json.schema(str)},
)
