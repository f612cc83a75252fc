"""rmw_zenoh's keys, tokens and attachments, held against what its documentation shows."""

from __future__ import annotations

import struct

import pytest
import zenoh
from zenoh import ext

from options.ros2.clock import SPAN_NS, ClockOffset
from options.ros2.keys import (
    Attachment,
    Publisher,
    gid_of,
    node_token,
    publication_key,
    publisher_token,
    publishers_key,
    read_attachment,
    read_publisher,
    subscription_token,
    topic_key,
    write_attachment,
)
from options.ros2.topic_buffer import Arrived, TopicBuffer

# The examples of docs/design.md in ros2/rmw_zenoh.
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CHATTER = f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
NAMED = f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
    f"std_msgs::msg::dds_::String_/{HASH}/::,7:,:,:,,"
)
LISTENER_NODE = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
LISTENER = (
    "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/"
    f"std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
)
STRING = "std_msgs/msg/String"
GID = bytes(range(100, 116))


@pytest.mark.parametrize(
    ("topic", "domain", "key"),
    [
        ("/chatter", 0, CHATTER),
        ("/robot1/chatter", 0, NAMED),
        ("/chatter", 7, CHATTER.replace("0/", "7/", 1)),
        ("/chatter", 0, f"{CHATTER.rsplit('/', 1)[0]}/TypeHashNotSupported"),
    ],
)
def test_a_topic_is_found_whatever_the_hash_of_its_type(topic: str, domain: int, key: str) -> None:
    wanted = zenoh.KeyExpr(topic_key(domain, topic, STRING))
    assert wanted.intersects(zenoh.KeyExpr(key))
    others = (
        topic_key(domain + 1, topic, STRING),
        topic_key(domain, "/r" + topic, STRING),
        topic_key(domain, topic, "std_msgs/msg/Int8"),
    )
    assert not any(zenoh.KeyExpr(other).intersects(zenoh.KeyExpr(key)) for other in others)


def test_a_publishers_token_says_its_topic_and_type() -> None:
    assert zenoh.KeyExpr(publishers_key(2)).includes(zenoh.KeyExpr(TALKER))
    assert read_publisher(TALKER) == Publisher("/chatter", STRING, HASH)
    below = TALKER.replace("%chatter", "%robot1%chatter")
    assert read_publisher(below) == Publisher("/robot1/chatter", STRING, HASH)
    assert not zenoh.KeyExpr(publishers_key(2)).intersects(zenoh.KeyExpr(LISTENER))
    assert read_publisher(LISTENER_NODE) is None


def test_a_subscription_is_shown_as_rmw_zenoh_shows_its_own() -> None:
    session = "aac3178e146ba6f1fc6e6a4085e77f21"
    assert node_token(2, session, "listener") == LISTENER_NODE
    talker = Publisher("/chatter", STRING, HASH)
    assert subscription_token(2, session, "listener", 10, talker, kept=False) == LISTENER


def test_a_publisher_is_shown_as_rmw_zenoh_shows_its_own() -> None:
    talker = read_publisher(TALKER)
    assert talker is not None
    assert publication_key(0, talker) == CHATTER
    told = publisher_token(2, "8b20917502ee955ac4476e0266340d5c", "talker", 10, talker, kept=False)
    assert told == TALKER.replace("::,7:", "::,10:")
    assert read_publisher(told) == talker
    kept = publisher_token(2, "8b", "talker", 10, talker, kept=True)
    assert kept.rsplit("/", 1)[1] == ":1:,1:,:,:,,"
    assert zenoh.KeyExpr(publishers_key(2)).includes(zenoh.KeyExpr(kept))
    assert len({gid_of(told), gid_of(kept)}) == 2
    assert len(gid_of(told)) == 16


def test_an_attachment_that_was_written_can_be_read() -> None:
    told = Attachment(5, 1_700_000_000_000_000_001, GID)
    assert read_attachment(write_attachment(told)) == told
    written = ext.z_serialize((ext.Int64(5), ext.Int64(told.published_ns), GID))
    assert write_attachment(told) == written.to_bytes()


@pytest.mark.parametrize(
    "raw",
    [
        struct.pack("<qq", 5, 1_700_000_000_000_000_001) + b"\x10" + GID,
        struct.pack("<qq", 5, 1_700_000_000_000_000_001) + GID,
        b"\x0fsequence_number"
        + struct.pack("<q", 5)
        + b"\x10source_timestamp"
        + struct.pack("<q", 1_700_000_000_000_000_001)
        + b"\x0asource_gid\x10"
        + GID,
    ],
    ids=["now", "without a length", "before June 2025"],
)
def test_an_attachment_says_number_time_and_publisher(raw: bytes) -> None:
    assert read_attachment(raw) == Attachment(5, 1_700_000_000_000_000_001, GID)


@pytest.mark.parametrize("raw", [b"", b"hello", bytes(16), bytes(32 + 9), bytes(100)])
def test_an_attachment_of_another_form_says_nothing(raw: bytes) -> None:
    assert read_attachment(raw) is None


def test_an_attachment_is_what_zenoh_itself_writes() -> None:
    written = ext.z_serialize((ext.Int64(9), ext.Int64(12), GID))
    assert read_attachment(written.to_bytes()) == Attachment(9, 12, GID)


def test_messages_that_did_not_come_are_counted_by_publisher() -> None:
    buffer = TopicBuffer("/points", "kind", 2)
    for publisher, sequence in ((b"a", 7), (b"a", 8), (b"b", 1), (b"a", 11), (b"b", 2), (b"a", 10)):
        buffer.put(Arrived(b"", 0, Attachment(sequence, 0, publisher)))
    assert buffer.lost == 2
    # It began anew.
    buffer.put(Arrived(b"", 0, Attachment(1, 0, b"a")))
    assert buffer.lost == 2
    buffer.put(Arrived(b"", 5, None))
    assert [message.received_ns for message in buffer.recent()] == [5, 0]


def test_the_clocks_differ_by_the_least_that_a_message_took() -> None:
    clock = ClockOffset()
    assert clock.ns is None
    for published, took in ((10, 1000), (20, 900), (30, 5000)):
        clock.learn(published, published + took)
    assert clock.ns == 900
    # The robot's clock was set: what it said before is forgotten, after a while.
    for step in range(1, 4):
        clock.learn(step * SPAN_NS, step * SPAN_NS + 7000)
    assert clock.ns == 7000
