"""What rmw_zenoh puts into keys and attachments, as its docs/design.md and sources say.

A topic's key is `<domain>/<topic>/<type>/<hash of the type>`, a publisher's liveliness token
`@ros2_lv/<domain>/<session>/<node>/<entity>/MP/<enclave>/<namespace>/<name>/<topic>/<type>/<hash>/
<QoS>` with `/` written as `%` (https://github.com/ros2/rmw_zenoh).
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass

_SPACE = "@ros2_lv"
_TOKEN_PARTS = 13
_TOPIC_PART, _TYPE_PART, _HASH_PART = 9, 10, 11
_VOLATILE, _KEPT, _KEPT_ONE = "::,10:,:,:,,", ":1:,10:,:,:,,", ":1:,1:,:,:,,"
"""QoS as rmw_zenoh writes it, what is the default left out: reliable, the last 10 messages; `_KEPT`
of a subscription asks for what was said before, too (transient local), `_KEPT_ONE` of a publisher
says the last message again."""

_ATTACHMENT = re.compile(
    rb"(?:\x0fsequence_number)?(?P<sequence>.{8})(?:\x10source_timestamp)?(?P<stamp>.{8})"
    rb"(?:\x0asource_gid)?(?:\x10?(?P<gid>.{16})|\x18?(?P<long>.{24}))",
    re.DOTALL,
)
"""Little-endian int64 each, then the publisher's id with its length. Releases of rmw_zenoh before
June 2025 (0.1.2, 0.2.4) wrote a name before each."""


@dataclass(frozen=True, slots=True)
class Attachment:
    """What rmw_zenoh says about a message."""

    sequence: int
    """Counts the publisher's messages, from 1 on."""
    published_ns: int
    """When it was published, on the publisher's clock; nanoseconds since the Unix epoch."""
    publisher: bytes


@dataclass(frozen=True, slots=True)
class Publisher:
    """What a publisher's liveliness token says."""

    topic: str
    kind: str
    """The type, as ROS users write it: `std_msgs/msg/String`."""
    type_hash: str


def topic_key(domain: int, topic: str, kind: str) -> str:
    """The key expression of a topic of one type, whatever the type's hash."""
    return f"{domain}/{topic.strip('/')}/{dds_type(kind)}/*"


def dds_type(kind: str) -> str:
    """`std_msgs/msg/String` as keys name it: `std_msgs::msg::dds_::String_`."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def publication_key(domain: int, to: Publisher) -> str:
    """The key that a publisher puts its messages on."""
    return f"{domain}/{to.topic.strip('/')}/{dds_type(to.kind)}/{to.type_hash}"


def publishers_key(domain: int) -> str:
    """The key expression of all publishers' tokens."""
    return f"{_SPACE}/{domain}/*/*/*/MP/**"


def read_publisher(key: str) -> Publisher | None:
    """What a publisher's token says; None for one of another form."""
    parts = key.split("/")
    if len(parts) < _TOKEN_PARTS:
        return None
    kind = parts[_TYPE_PART].replace("::dds_::", "/").replace("::", "/").removesuffix("_")
    return Publisher(parts[_TOPIC_PART].replace("%", "/"), kind, parts[_HASH_PART])


def node_token(domain: int, session: str, node: str) -> str:
    """The liveliness token of a node without namespace: it appears in `ros2 node list`."""
    return f"{_SPACE}/{domain}/{session}/0/0/NN/%/%/{node}"


def subscription_token(
    domain: int, session: str, node: str, entity: int, to: Publisher, *, kept: bool
) -> str:
    """The liveliness token of the node's subscription to what a publisher says; `kept`: also to
    what it said before."""
    return _token("MS", domain, session, node, entity, to, _KEPT if kept else _VOLATILE)


def publisher_token(
    domain: int, session: str, node: str, entity: int, one: Publisher, *, kept: bool
) -> str:
    """The liveliness token of the node's publisher; `kept`: it says its last message again to who
    subscribes later."""
    return _token("MP", domain, session, node, entity, one, _KEPT_ONE if kept else _VOLATILE)


def _token(
    what: str, domain: int, session: str, node: str, entity: int, topic: Publisher, qos: str
) -> str:
    named, kind = topic.topic.replace("/", "%"), dds_type(topic.kind)
    return (
        f"{_SPACE}/{domain}/{session}/0/{entity}/{what}/%/%/{node}/{named}/{kind}/"
        f"{topic.type_hash}/{qos}"
    )


def gid_of(token: str) -> bytes:
    """16 bytes that name an entity wherever its messages go.

    rmw_zenoh takes another hash of the token (XXH3); who receives it only compares.
    """
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def write_attachment(told: Attachment) -> bytes:
    """What goes with a message."""
    numbers = struct.pack("<qq", told.sequence, told.published_ns)
    return numbers + bytes((len(told.publisher),)) + told.publisher


def read_attachment(raw: bytes) -> Attachment | None:
    """What an attachment says; None for one of another form."""
    found = _ATTACHMENT.fullmatch(raw)
    if found is None:
        return None
    sequence, published_ns = struct.unpack("<qq", found["sequence"] + found["stamp"])
    return Attachment(sequence, published_ns, found["gid"] or found["long"])
