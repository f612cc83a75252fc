"""Lets schemathesis find what there is: without it no generated session would ever begin.

In every second valid body what the definition describes becomes something that the test's network
has; fields that the definition does not know stay.
"""

from __future__ import annotations

import itertools
from typing import Any

import schemathesis

KNOWN: dict[str, Any] = {
    "applicationServer": {"ipv4Address": "10.77.0.1"},
    "qosProfile": "QOS_M",
    "duration": 600,
}
LEFT_OUT = {"sink", "sinkCredential", "devicePorts", "applicationServerPorts", "name", "status"}
ADDRESSES = ("10.77.0.2", "10.77.0.3")
_counter = itertools.count()


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: dict[str, Any]) -> None:
    """Changes a case that is about to be sent."""
    valid = case.meta is not None and case.meta.generation.mode.is_positive
    number = next(_counter)
    if valid and isinstance(case.body, dict) and number % 2:
        case.body = with_known_values(case.body, ADDRESSES[number // 2 % 2])


def with_known_values(body: dict[str, Any], address: str) -> dict[str, Any]:
    """A valid body with a device, a profile and addresses that are there."""
    changed = {name: value for name, value in body.items() if name not in LEFT_OUT}
    if "requestedAdditionalDuration" in body:
        return changed
    changed["device"] = {"ipv4Address": {"publicAddress": address, "privateAddress": address}}
    return changed | KNOWN if "qosProfile" in body else changed
