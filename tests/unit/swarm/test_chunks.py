"""Large answers in parts: what is put together, what is refused, and how credit follows a link."""

from __future__ import annotations

import random
import struct
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.chunks import (
    MAX_PARTS,
    PART_BYTES,
    AskParts,
    Assembly,
    MoreParts,
    read_query,
    split,
)
from swarm.credit import (
    FIRST_PARTS,
    MAX_PARTS_UNDER_WAY,
    QUICK_S,
    SLOW_S,
    Credits,
    Download,
    Window,
)
from swarm.errors import MessageError
from swarm.messages import MAX_MESSAGE_BYTES

DATA = random.Random(1).randbytes(5 * PART_BYTES + 7)
BATCH_BYTES = 65_535
HEADERS_BYTES = 300


def parts_of(data: bytes = DATA) -> list[tuple[bytes, bytes]]:
    parts = [(attachment, part) for attachment, part in split(data) if attachment is not None]
    assert len(parts) == len(split(data))
    return parts


def described(index: int, count: int, total: int, version: int = 1) -> bytes:
    return struct.pack("<BHHI", version, index, count, total)


@given(st.binary(max_size=200) | st.just(DATA[:PART_BYTES]))
def test_a_small_answer_is_one_reply_as_it_is(data: bytes) -> None:
    assert split(data) == [(None, data)]


@given(st.integers(PART_BYTES + 1, len(DATA)), st.randoms(use_true_random=False))
def test_parts_in_any_order_give_the_answer(size: int, order: random.Random) -> None:
    data = DATA[:size]
    parts = parts_of(data)
    order.shuffle(parts)
    assembly = Assembly()
    *first, last = parts
    assert all(assembly.add(*part) is None for part in first)
    assert assembly.add(*last) == data
    assert assembly.received == assembly.total == size


def test_the_largest_message_fits_the_limits_and_four_parts_a_batch() -> None:
    parts = parts_of(bytes(MAX_MESSAGE_BYTES))
    assert len(parts) <= MAX_PARTS
    assert max(len(part) for _, part in parts) * 4 + HEADERS_BYTES <= BATCH_BYTES


def test_an_answer_larger_than_a_message_is_not_split() -> None:
    with pytest.raises(MessageError, match=str(MAX_MESSAGE_BYTES)):
        split(bytes(MAX_MESSAGE_BYTES + 1))


@pytest.mark.parametrize(
    "attachment",
    [
        b"",
        b"\x01",
        described(0, 2, 100) + b"\x00",
        described(0, 2, 100, version=2),
        described(0, 0, 100),
        described(0, 1, 100),
        described(2, 2, 100),
        described(0, MAX_PARTS + 1, 100_000),
        described(0, 3, 2),
        described(0, 2, MAX_MESSAGE_BYTES + 1),
        described(0, 2, 2**32 - 1),
    ],
)
def test_a_part_that_cannot_be_is_refused(attachment: bytes) -> None:
    assembly = Assembly()
    with pytest.raises(MessageError, match="part"):
        assembly.add(attachment, b"x")
    assert assembly.received == 0


@pytest.mark.parametrize(
    ("attachment", "payload", "says"),
    [
        (described(0, 3, 100), b"x", "came twice"),
        (described(1, 4, 100), b"x", "parts before it"),
        (described(1, 3, 101), b"x", "parts before it"),
        (described(1, 3, 100), b"", "has 0 bytes"),
        (described(1, 3, 100), bytes(90), "90 bytes"),
        (described(1, 3, 100), bytes(MAX_MESSAGE_BYTES), "more parts must follow"),
    ],
)
def test_a_part_that_contradicts_the_others_is_refused_before_it_is_kept(
    attachment: bytes, payload: bytes, says: str
) -> None:
    assembly = Assembly()
    assert assembly.add(described(0, 3, 100), bytes(10)) is None
    with pytest.raises(MessageError, match=says):
        assembly.add(attachment, payload)
    assert assembly.received == 10


def test_parts_with_fewer_bytes_than_announced_are_no_answer() -> None:
    assembly = Assembly()
    assert assembly.add(described(0, 2, 100), bytes(10)) is None
    with pytest.raises(MessageError, match="have 20 bytes, not 100"):
        assembly.add(described(1, 2, 100), bytes(10))


def test_an_incomplete_answer_says_what_is_missing() -> None:
    assembly = Assembly()
    for part in (parts_of()[0], parts_of()[2]):
        assembly.add(*part)
    text = str(assembly)
    assert "2 of 6 parts" in text
    assert f"{2 * PART_BYTES} of {len(DATA)} bytes" in text
    assert text.endswith("missing is 1")


def test_what_travels_with_a_query_is_read_as_it_was_written() -> None:
    ask, more = AskParts(token=2**64 - 1, timeout_s=1.25, parts=3), MoreParts(token=7, parts=9)
    assert read_query(ask.pack()) == ask
    assert read_query(more.pack()) == more


@given(st.none() | st.binary(max_size=40))
def test_any_attachment_of_a_query_is_read(attachment: bytes | None) -> None:
    read_query(attachment)


def test_credit_grows_on_a_quick_link_and_shrinks_on_a_slow_one_within_its_limits() -> None:
    window = Window()
    assert window.parts == FIRST_PARTS
    for _ in range(10):
        window.note(QUICK_S / 2, may_grow=True)
    assert window.parts == MAX_PARTS_UNDER_WAY
    window.note((QUICK_S + SLOW_S) / 2, may_grow=True)
    assert window.parts == MAX_PARTS_UNDER_WAY
    for _ in range(10):
        window.note(2 * SLOW_S, may_grow=False)
    assert window.parts == 1
    window.note(QUICK_S / 2, may_grow=False)
    assert window.parts == 1


def test_an_asker_gives_credit_when_all_that_it_gave_has_come() -> None:
    given_parts: list[int] = []
    download = Download(Window(), given_parts.append)
    parts = parts_of()
    for part in parts[: FIRST_PARTS - 1]:
        assert download.add(*part) is None
    assert given_parts == []
    assert download.add(*parts[FIRST_PARTS - 1]) is None
    assert len(given_parts) == 1
    assert given_parts[0] > FIRST_PARTS
    for part in parts[FIRST_PARTS:-1]:
        assert download.add(*part) is None
    assert download.add(*parts[-1]) == DATA
    assert len(given_parts) == 1


def test_a_server_waits_for_credit_and_for_no_less_than_it_needs() -> None:
    credit, until = Credits(), time.monotonic() + 20.0
    credit.open(1, 2)
    assert credit.wait(1, 2, until)
    sent = threading.Event()

    def send() -> None:
        if credit.wait(1, 4, until):
            sent.set()

    thread = threading.Thread(target=send)
    thread.start()
    for parts in (3, 1):
        credit.give(1, parts)
    credit.give(2, 9)
    assert not sent.is_set()
    credit.give(1, 4)
    thread.join(20.0)
    assert sent.is_set()


def test_a_server_whose_asker_has_gone_stops() -> None:
    credit = Credits()
    credit.open(1, 2)
    assert not credit.wait(1, 1, time.monotonic() - 1.0)
    assert not credit.wait(1, 3, time.monotonic() + 0.01)
    credit.close(1)
    assert not credit.wait(1, 1, time.monotonic() + 20.0)


def test_a_closing_server_stops_what_is_under_way_and_begins_no_more() -> None:
    credit = Credits()
    credit.open(1, 2)
    credit.close_all()
    credit.open(2, 2)
    assert not credit.wait(1, 1, time.monotonic() + 20.0)
    assert not credit.wait(2, 1, time.monotonic() + 20.0)
