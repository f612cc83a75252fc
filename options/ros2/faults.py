"""Why a live robot has no scan: in words that name the topic, the value and the limit."""

from __future__ import annotations

from options.ros2.address import Address
from options.ros2.link import Link
from options.ros2.topic_buffer import Arrived, TopicBuffer
from swarm.errors import WorldError

EARLY_NS = 100_000_000
"""So much a scan may be stamped after it was published: no clock is exact."""
MAX_NAMED = 10


class Fault(WorldError):
    """Why there is no scan; `kind` stays while numbers in the text change."""

    def __init__(self, kind: str, why: str) -> None:
        super().__init__(why)
        self.kind = kind


def nothing_on(buffer: TopicBuffer, link: Link, address: Address) -> Fault:
    """Why nothing has come on a topic."""
    topic, kind = buffer.topic, buffer.kind
    if link.fault:
        return Fault("refused", f"the router at {address.router} cannot be used: {link.fault}")
    if not link.connected:
        return Fault("router", f"no Zenoh router at {address.router} yet")
    publishers = link.publishers()
    kinds = sorted({one.kind for one in publishers if one.topic == topic})
    if kind in kinds:
        return Fault("waiting", f"topic {topic} is announced, but nothing has come on it yet")
    if kinds:
        return Fault("type", f"topic {topic} carries {', '.join(kinds)}; it must be {kind}")
    others = sorted({one.topic for one in publishers if one.kind == kind})
    return Fault(
        "unpublished",
        f"nobody publishes topic {topic} in domain {address.domain}; {kind} comes on "
        f"{', '.join(others[:MAX_NAMED]) or 'no topic'}",
    )


def check_age(
    address: Address, newest: Arrived, message: Arrived, taken_ns: int, now_ns: int
) -> None:
    """Raises Fault when a scan is not of now.

    Args:
        address: says what is allowed.
        newest: the newest scan that came.
        message: the scan to be used, which may be an older one, for want of poses.
        taken_ns: when that was taken, and
        now_ns: now, both on this machine's clock, nanoseconds since the Unix epoch.
    """
    topic, allowed_s = address.points, address.max_age
    silent_s, age_s = (now_ns - newest.received_ns) / 1e9, (now_ns - taken_ns) / 1e9
    if taken_ns > message.received_ns + EARLY_NS:
        raise Fault(
            "clock",
            f"a scan on {topic} is stamped {(taken_ns - message.received_ns) / 1e9:.3f} s after "
            f"it came; allowed: {EARLY_NS / 1e9} s. Set the sensor's clock, or take the time of "
            "arrival (stamps=arrival)",
        )
    if silent_s > allowed_s:
        raise Fault(
            "silent", f"topic {topic} has been silent for {silent_s:.1f} s; allowed: {allowed_s} s"
        )
    if age_s > allowed_s and message is not newest:
        raise Fault(
            "poses",
            f"poses on {address.odom or address.tf} come too late: the newest scan on {topic} "
            f"that one follows is {age_s:.3f} s old; allowed: {allowed_s} s",
        )
    if age_s > allowed_s:
        raise Fault(
            "old",
            f"scans on {topic} are stamped {age_s:.3f} s before now; allowed: {allowed_s} s "
            "(max_age). Set the sensor's clock, or take the time of arrival (stamps=arrival)",
        )
