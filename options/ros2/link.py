"""The Zenoh session with a robot's router: what comes on topics, and who publishes them."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from typing import Any

import zenoh
from zenoh import ext

from options.ros2 import keys
from options.ros2.address import Address
from options.ros2.keys import Publisher
from options.ros2.topic_buffer import Arrived, TopicBuffer
from swarm.errors import TransportError
from swarm.log import Logger
from swarm.transport import Entity, close_zenoh, open_zenoh

JOIN_S = 2.0
RETRY_S = 0.5
"""From a router that could not be used to the next attempt."""
MAX_FAULT = 300
"""Characters of what Zenoh says."""
MAX_PUBLISHERS = 10_000
"""Of a whole domain; more are not told apart in messages."""


class Link:
    """Fills buffers until closed. The router may come, go and come back at any time."""

    def __init__(
        self, address: Address, buffers: Sequence[TopicBuffer], node: str, log: Logger
    ) -> None:
        """Returns at once; a thread reaches for the router. `node`: what the robot's `ros2 node
        list` calls this process."""
        self.connected = False
        """Whether the router was reached once, and all was declared."""
        self.fault = ""
        """Why a router that was reached could not be used, until it can."""
        self._address = address
        self._inlets = {buffer.topic: buffer for buffer in buffers}
        self._node = node
        self._log = log
        self._closing = threading.Event()
        self._publishers: dict[str, Publisher] = {}
        self._announced: queue.SimpleQueue[Publisher | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="ros2", daemon=True)
        self._thread.start()

    def publishers(self) -> list[Publisher]:
        """All that are announced in the robot's domain."""
        return list(self._publishers.values())

    def close(self) -> None:
        """Withdraws everything; never waits longer than a few seconds."""
        self._closing.set()
        self._announced.put(None)
        self._thread.join(JOIN_S)
        self._log.info("ros2_down")

    def _run(self) -> None:
        config: dict[str, Any] = {
            "mode": "client",
            "connect/endpoints": [self._address.router],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
        }
        while not self._closing.is_set():
            try:
                session = open_zenoh(config, stop=self._closing)
            except TransportError:
                return  # closed before the router could be reached
            entities: list[Entity] = []
            try:
                self._serve(session, entities)
            except zenoh.ZError as error:
                self._note_fault(str(error)[:MAX_FAULT])
            finally:
                close_zenoh(session, entities)
            self._closing.wait(RETRY_S)

    def _serve(self, session: zenoh.Session, entities: list[Entity]) -> None:
        """Fills the buffers until closed. Raises ZError when something cannot be declared."""
        self._publishers.clear()
        self._declare(session, entities)
        self.connected, self.fault = True, ""
        self._log.info("ros2_up", router=self._address.router, topics=list(self._inlets))
        self._subscribe_in_the_open(session, entities)

    def _note_fault(self, fault: str) -> None:
        if fault != self.fault:
            self._log.error("ros2_failed", router=self._address.router, error=fault)
        self.connected, self.fault = False, fault

    def _declare(self, session: zenoh.Session, entities: list[Entity]) -> None:
        domain = self._address.domain
        for buffer in self._inlets.values():
            key = keys.topic_key(domain, buffer.topic, buffer.kind)
            if buffer.topic == self._address.tf_static:
                # It is said once, to be asked for by those who come later.
                history = ext.HistoryConfig(detect_late_publishers=True)
                entities.append(
                    ext.declare_advanced_subscriber(
                        session, key, self._receiver(buffer), history=history
                    )
                )
            else:
                entities.append(session.declare_subscriber(key, self._receiver(buffer)))
        entities.append(
            session.liveliness().declare_subscriber(
                keys.publishers_key(domain), self._note_publisher, history=True
            )
        )
        token = keys.node_token(domain, str(session.zid()), self._node)
        entities.append(session.liveliness().declare_token(token))

    def _subscribe_in_the_open(self, session: zenoh.Session, entities: list[Entity]) -> None:
        """Shows the subscriptions to ROS until closed.

        Some drivers publish only when somebody listens, which they learn from tokens. And since
        2026 (ros2/rmw_zenoh#930) rmw_zenoh itself puts volatile messages of types that buffers can
        carry, as scans are, on a topic's key only when a token tells of a subscription without
        buffer backends, as ours is: without it no scan might come at all.
        """
        shown: set[Publisher] = set()
        while (publisher := self._announced.get()) is not None:
            if publisher in shown:
                continue
            shown.add(publisher)
            token = keys.subscription_token(
                self._address.domain,
                str(session.zid()),
                self._node,
                len(shown),
                publisher,
                kept=publisher.topic == self._address.tf_static,
            )
            entities.append(session.liveliness().declare_token(token))

    def _receiver(self, buffer: TopicBuffer) -> Any:
        # On Zenoh's own threads: nothing is decoded here.
        def receive(sample: zenoh.Sample) -> None:
            now_ns = time.time_ns()
            told = None
            if sample.attachment is not None:
                told = keys.read_attachment(sample.attachment.to_bytes())
            buffer.put(Arrived(sample.payload.to_bytes(), now_ns, told))

        return receive

    def _note_publisher(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        publisher = keys.read_publisher(token)
        if sample.kind != zenoh.SampleKind.PUT or publisher is None:
            self._publishers.pop(token, None)
            return
        if len(self._publishers) < MAX_PUBLISHERS:
            self._publishers[token] = publisher
        buffer = self._inlets.get(publisher.topic)
        if buffer is not None and buffer.kind == publisher.kind:
            self._announced.put(publisher)


def node_name(process: str, robot: str) -> str:
    """What ROS calls a process that reads a robot's topics: each has a name of its own."""
    return f"coadapt_{process}_{robot.replace('-', '_')}"
