"""Bodies of requests for Quality on Demand that are no JSON."""

from __future__ import annotations

import msgspec
import pytest

from network_controller.qod.messages import CreateSession, QosProfileRequest, read


@pytest.mark.parametrize(
    "raw",
    [b'"\xcf"', b'{"device": {"phoneNumber": "\x85"}}', b'{"a":' * 100_000, b""],
    ids=["no UTF-8", "no UTF-8 within", "deep", "nothing"],
)
@pytest.mark.parametrize("kind", [CreateSession, QosProfileRequest])
def test_what_is_no_json_raises_the_one_error_that_is_named(raw: bytes, kind: type) -> None:
    with pytest.raises(msgspec.DecodeError):
        read(raw, kind)
