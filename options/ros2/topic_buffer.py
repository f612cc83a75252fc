"""The newest messages of one topic, as they came."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

from options.ros2.clock import ClockOffset
from options.ros2.keys import Attachment

MAX_PUBLISHERS = 64


@dataclass(frozen=True, slots=True)
class Arrived:
    """One message."""

    payload: bytes
    """CDR."""
    received_ns: int
    """On this machine's clock, nanoseconds since the Unix epoch."""
    attachment: Attachment | None


class TopicBuffer:
    """Keeps the last messages of a topic; safe to use from several threads."""

    def __init__(self, topic: str, kind: str, keep: int) -> None:
        self.topic = topic
        self.kind = kind
        self.clock = ClockOffset()
        self.lost = 0
        """Messages that publishers counted and that did not come."""
        self._lock = threading.Lock()
        self._messages: deque[Arrived] = deque(maxlen=keep)
        self._sequences: dict[bytes, int] = {}

    def put(self, message: Arrived) -> None:
        """Adds the newest message; the oldest leaves a full buffer."""
        with self._lock:
            self._messages.append(message)
            if message.attachment is not None:
                self._count(message.attachment)
                self.clock.learn(message.attachment.published_ns, message.received_ns)

    def recent(self) -> list[Arrived]:
        """What is kept, the newest first."""
        with self._lock:
            return list(reversed(self._messages))

    def take(self) -> list[Arrived]:
        """What came since the last call and is kept, the oldest first."""
        with self._lock:
            taken = list(self._messages)
            self._messages.clear()
            return taken

    def _count(self, told: Attachment) -> None:
        if told.publisher not in self._sequences and len(self._sequences) >= MAX_PUBLISHERS:
            self._sequences.clear()
        before = self._sequences.get(told.publisher, told.sequence - 1)
        # A smaller number: the publisher began anew, or the network changed the order.
        self.lost += max(0, told.sequence - before - 1)
        self._sequences[told.publisher] = max(told.sequence, before)
