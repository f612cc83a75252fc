"""Facts about network interfaces of this namespace."""

from __future__ import annotations

import json
import socket
from typing import Any

from network_controller.drivers.command import attempt


def index_of(device: str) -> int:
    """The kernel's number of an interface; 0 when there is none of that name."""
    try:
        return socket.if_nametoindex(device)
    except OSError:
        return 0


def facts_of(device: str) -> dict[str, Any]:
    """What `ip -j link` tells of an interface; empty when there is none of that name."""
    shown = attempt("ip", "-j", "link", "show", "dev", device).stdout
    found: list[dict[str, Any]] = json.loads(shown or "[]")
    return found[0] if found else {}


def master_of(device: str) -> str:
    """The bridge that an interface hangs on; empty for none."""
    return str(facts_of(device).get("master", ""))
