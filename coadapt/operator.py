"""Who sits at this command line."""

from __future__ import annotations

import getpass
import socket


def operator() -> str:
    """As it stands in the journals and logs of whoever is asked."""
    try:
        return f"{getpass.getuser()}@{socket.gethostname()}"[:64]
    except (OSError, KeyError):
        return "unknown"
