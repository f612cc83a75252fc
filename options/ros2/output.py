"""Where fused objects go to in ROS 2, and publishing them there as rmw_zenoh does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from zenoh import ext

from options.ros.definitions import HASHES, NO_HASH
from options.ros.fused import PREFIX, TOPICS, Said, Topic
from options.ros2 import keys
from options.ros2.address import TOPIC, Place, split, wrong
from options.ros2.keys import Attachment, Publisher
from swarm.errors import SettingError
from swarm.transport import Entity, close_zenoh, open_zenoh

OUTPUT_FORM = "ros2://HOST[:PORT]/DOMAIN[?prefix=/NAME][&hashes=no]"
_OPTIONS = ("prefix", "hashes")


class Target(Place, frozen=True, kw_only=True):
    """Where to publish. Make it with `parse_target`, which checks every part."""

    prefix: str = PREFIX
    """Before the topics' names."""
    hashes: bool = True
    """Whether types have hashes; ROS 2 Humble has none."""


def parse_target(text: str) -> Target:
    """The target in a `ros2://` URL.

    Raises SettingError that names the part, its value and what is allowed.
    """
    place, options = split(text, OUTPUT_FORM)
    for name in options:
        if name not in _OPTIONS:
            allowed = ", ".join(_OPTIONS)
            raise SettingError(f"address {text!r} has the option {name!r}; allowed: {allowed}")
    prefix, hashes = options.get("prefix", PREFIX), options.get("hashes", "yes")
    if not TOPIC.fullmatch(prefix):
        raise wrong(text, "prefix", prefix, "the beginning of a topic's name, like /coadapt")
    if hashes not in ("yes", "no"):
        raise wrong(text, "hashes", hashes, "yes, or no for ROS 2 Humble")
    return Target(
        host=place.host,
        port=place.port,
        domain=place.domain,
        prefix=prefix,
        hashes=hashes == "yes",
    )


class Output:
    """One node with a publisher a topic. Use as a context manager."""

    def __init__(
        self,
        target: Target,
        node: str,
        stop: threading.Event,
        on_wait: Callable[[str], object] | None = None,
    ) -> None:
        """Returns when the router of ROS was reached; it may go and come back from then on.

        `on_wait` hears why it cannot be reached. Raises TransportError once `stop` is set before
        that, and ZError where the router allows nothing.
        """
        config: dict[str, Any] = {
            "mode": "client",
            "connect/endpoints": [target.router],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            # Kept messages are found by their times.
            "timestamping/enabled": {"router": True, "peer": True, "client": True},
        }
        self._session = open_zenoh(config, stop=stop, on_wait=on_wait)
        self._entities: list[Entity] = []
        self._counts: dict[Topic, int] = {}
        try:
            self._ways = {
                topic: self._declare(target, node, number, topic)
                for number, topic in enumerate(TOPICS, 1)
            }
            token = keys.node_token(target.domain, str(self._session.zid()), node)
            self._entities.append(self._session.liveliness().declare_token(token))
        except BaseException:
            close_zenoh(self._session)
            raise

    def __enter__(self) -> Output:
        return self

    def __exit__(self, *_: object) -> None:
        close_zenoh(self._session, self._entities)

    def put(self, said: Said) -> None:
        """Publishes one message. Raises ZError when the session is closed."""
        publisher, gid = self._ways[said.topic]
        number = self._counts[said.topic] = self._counts.get(said.topic, 0) + 1
        told = Attachment(number, time.time_ns(), gid)
        publisher.put(said.payload, attachment=keys.write_attachment(told))

    def _declare(self, target: Target, node: str, number: int, topic: Topic) -> tuple[Any, bytes]:
        """A topic's publisher, and the id in its attachments."""
        kind = HASHES[topic.kind] if target.hashes else NO_HASH
        named = Publisher(target.prefix + topic.name, topic.kind, kind)
        session = str(self._session.zid())
        token = keys.publisher_token(target.domain, session, node, number, named, kept=topic.kept)
        key = keys.publication_key(target.domain, named)
        publisher: Any
        if topic.kept:
            publisher = ext.declare_advanced_publisher(
                self._session, key, cache=ext.CacheConfig(1), publisher_detection=True
            )
        else:
            publisher = self._session.declare_publisher(key)
        self._entities.append(publisher)
        self._entities.append(self._session.liveliness().declare_token(token))
        return publisher, keys.gid_of(token)
