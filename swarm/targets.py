"""Prometheus' targets, as a file that follows who tells where its metrics are (`file_sd`)."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import zenoh

from swarm import keyspace
from swarm.announce import PLACE
from swarm.errors import IdentityError, KeyspaceError
from swarm.files import write_whole
from swarm.log import Logger
from swarm.trust.roles import role_of

GONE_S = 5.0
"""How long a target stays whose token is gone: a router that starts anew loses all for a moment."""
MAX_TARGETS = 2000
"""Tokens come from the network."""


class Targets:
    """The targets of one swarm in one file. Tokens come on Zenoh's threads; `look` is called now
    and then, on one other."""

    def __init__(
        self,
        path: Path,
        swarm: str,
        log: Logger,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Goes on with what an earlier process wrote."""
        self._path = path
        self._swarm = swarm
        self._log = log
        self._monotonic = monotonic
        self._lock = threading.Lock()
        self._gone: dict[str, float | None] = {}
        """By key: since when its token is gone; None: it is there."""
        self._subscriber: object = None
        self._written = ""
        self._failed = ""
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            now_s = monotonic()
            for group in json.loads(path.read_text()):
                key = group["labels"]["__meta_coadapt_key"]
                if target_of(key) is not None:
                    self._gone[key] = now_s

    def attach(self, session: zenoh.Session) -> None:
        """Listens on a router's own session, which may do so by itself."""
        self._subscriber = session.liveliness().declare_subscriber(
            keyspace.metrics(self._swarm, keyspace.ANY), self._receive, history=True
        )

    def look(self) -> None:
        """Writes the file where it has changed; one that cannot be written is tried again."""
        now_s = self._monotonic()
        with self._lock:
            for key, gone in list(self._gone.items()):
                if gone is not None and now_s - gone > GONE_S:
                    del self._gone[key]
            keys = sorted(self._gone)
        text = json.dumps(groups(keys), indent=1)
        if text == self._written and self._path.exists():
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, text, mode=0o644)
            self._written, self._failed = text, ""
        except OSError as error:
            if str(error) != self._failed:
                self._log.warning("targets_unwritten", path=str(self._path), error=str(error))
            self._failed = str(error)

    def _receive(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if target_of(key) is None:
            return
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                if key in self._gone or len(self._gone) < MAX_TARGETS:
                    self._gone[key] = None
            elif self._gone.get(key, 0.0) is None:
                self._gone[key] = self._monotonic()


def target_of(key: str) -> dict[str, Any] | None:
    """What Prometheus is told of a token; None for a key that tells nothing usable."""
    try:
        name, place = keyspace.metrics_of(key)
        role = role_of(name)
    except (KeyspaceError, IdentityError):
        return None
    found = PLACE.fullmatch(place)
    if found is None or not 0 < int(found["address"].rpartition(":")[2]) < 65536:
        return None
    instance = f"robot-{name}" if role.kind == "robot" else name
    if name == "router":
        # One that has no name of its own.
        instance = f"router-{found['address'].rpartition(':')[0].strip('[]')}"
    labels = {
        "__scheme__": found["scheme"],
        "__meta_coadapt_key": key,
        "job": role.kind,
        "role": role.kind,
        "instance": instance,
    }
    if role.kind in ("robot", "ego"):
        labels["robot"] = role.name
    return {"targets": [found["address"]], "labels": labels}


def groups(keys: list[str]) -> list[dict[str, Any]]:
    """The content of the file. Of two that have one name, the first place counts: Prometheus would
    mix their counters."""
    found: dict[str, dict[str, Any]] = {}
    for key in keys:
        target = target_of(key)
        if target is not None:
            found.setdefault(target["labels"]["instance"], target)
    return list(found.values())
