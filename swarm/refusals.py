"""Counts the sessions that a secure router refuses.

Zenoh tells of them on standard output alone, a line for each link.
"""

from __future__ import annotations

import math
import os
import re
import threading
import time
from contextlib import suppress

import zenoh
from prometheus_client import Counter

from swarm.log import Logger

_STDOUT = 1
_REFUSED = re.compile(r"zenoh_link_tls\S*?:\S* (?P<why>.*?)(\. Hint: .*)?$")
_COLOURS = re.compile(r"\x1b\[\d*m")
_KNOCKED = "tls handshake eof"
"""Somebody connected and left without a word, as those do who look whether a port is open."""
LOG_S = 1.0
"""A line of the log stands for all refusals within so long."""


class Refusals:
    """Takes the place of the process's standard output until closed: what Zenoh says there of
    refused links is counted and logged, everything else goes on to where it went."""

    def __init__(self, log: Logger) -> None:
        self.counted = Counter(
            "coadapt_router_refused_links",
            "Transport links that were refused for want of a certificate that holds; a client "
            "tries three at a time, and again.",
            registry=None,
        )
        self._log = log
        self._unsaid = 0
        """Refused since the last line of the log."""
        self._said_at = -math.inf
        """Seconds of the steady clock."""
        self._out = os.dup(_STDOUT)
        read, write = os.pipe()
        os.dup2(write, _STDOUT)
        os.close(write)
        # Sessions that are open before this is called tell nothing.
        zenoh.init_log_from_env_or("off,zenoh_link_tls=warn")
        self._reader = threading.Thread(
            target=self._read, args=(read,), name="zenoh-log", daemon=True
        )
        self._reader.start()

    def close(self) -> None:
        """Gives standard output back."""
        os.dup2(self._out, _STDOUT)
        self._reader.join()
        os.close(self._out)

    def _read(self, read: int) -> None:
        with os.fdopen(read, errors="replace") as lines:
            for line in lines:
                told = _REFUSED.search(_COLOURS.sub("", line.rstrip()))
                if told is None:
                    # A full disk must not stop a router.
                    with suppress(OSError):
                        os.write(self._out, line.encode())
                elif told["why"] != _KNOCKED:
                    self._refused(told["why"])

    def _refused(self, why: str) -> None:
        self.counted.inc()
        self._unsaid += 1
        if (now := time.monotonic()) - self._said_at >= LOG_S:
            self._log.warning("session_refused", why=why, links=self._unsaid)
            self._unsaid, self._said_at = 0, now
