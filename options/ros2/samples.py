"""What says where a robot is: decoded, with the time at which it holds, and the last seconds."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from options.ros.cdr import CdrError
from options.ros.messages import Odometry, Transform, read_transforms
from options.ros2.topic_buffer import Arrived, TopicBuffer

KEEP_NS = 3_000_000_000
"""Poses older than this are forgotten: no scan waits longer for its own."""
JITTER_NS = 200_000_000
"""So much a message may be stamped before the one that came before it, as messages overtake each
other. What goes farther back is by a clock that was set back."""

T = TypeVar("T")


class Decoded(Generic[T]):
    """The messages of one buffer, decoded."""

    def __init__(self, buffer: TopicBuffer, read: Callable[[bytes], T]) -> None:
        self.fault = ""
        """What is wrong with the newest message; empty when nothing is."""
        self._inlet = buffer
        self._read = read

    def take(self) -> Iterator[tuple[Arrived, T]]:
        """What came since the last call, the oldest first, but for malformed messages."""
        for message in self._inlet.take():
            try:
                content = self._read(message.payload)
            except (CdrError, struct.error) as error:
                self.fault = f"a message on {self._inlet.topic} is malformed: {error}"
                continue
            self.fault = ""
            yield message, content


class Static:
    """Transforms that stay."""

    def __init__(self, buffer: TopicBuffer) -> None:
        self.under: dict[str, Transform] = {}
        """Each by its child frame."""
        self._messages = Decoded(buffer, read_transforms)

    @property
    def fault(self) -> str:
        """As `Decoded.fault`."""
        return self._messages.fault

    def update(self) -> None:
        """Takes what has come."""
        for _, found in self._messages.take():
            self.under |= {one.child: one for one in found}


def stamp_of(header_ns: int, message: Arrived) -> int:
    """When a message's content holds: its header's stamp, else when it was published or came."""
    if header_ns or message.attachment is None:
        return header_ns or message.received_ns
    return message.attachment.published_ns


def stamped(one: Transform, message: Arrived) -> Transform:
    """The transform with the time at which it holds."""
    return Transform(
        stamp_of(one.stamp_ns, message), one.parent, one.child, one.translation, one.rotation
    )


def odometry_stamp(one: Odometry) -> int:
    """When an odometry holds, nanoseconds."""
    return one.transform.stamp_ns


def transform_stamp(one: Transform) -> int:
    """When a transform holds, nanoseconds."""
    return one.stamp_ns


def keep(kept: deque[T], one: T, stamp: Callable[[T], int]) -> None:
    """Adds the newest of samples in the order in which they came, and drops what is old.

    `stamp` says when a sample holds, nanoseconds of the robot's clock.
    """
    if kept and stamp(one) < stamp(kept[-1]) - JITTER_NS:
        # The robot's clock was set back: samples of before and after would share stamps.
        kept.clear()
    kept.append(one)
    while len(kept) > 2 and stamp(kept[0]) < stamp(one) - KEEP_NS:
        kept.popleft()
