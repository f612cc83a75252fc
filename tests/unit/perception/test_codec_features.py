"""Feature maps on the wire: what comes back, and that nothing else than PayloadError comes of what
is damaged."""

from __future__ import annotations

import math
import struct
import tracemalloc
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec.envelope import seal, unseal
from perception.codec.features import (
    KIND_CODES,
    KIND_STEPS,
    LEVELS,
    CellBlock,
    decode_cells,
    encode_cells,
)
from swarm.errors import PayloadError

VERSION = 0xDEADBEEF
HEAD = struct.Struct("<IHH6fII")
CHANNELS, PARTS = 5, 3


def block(
    shape: tuple[int, int] = (6, 7),
    cells: int = 11,
    wide: int = CHANNELS,
    coded: bool = False,
    seed: int = 0,
) -> CellBlock:
    rng = np.random.default_rng(seed)
    present = np.zeros(shape[0] * shape[1], dtype=np.bool_)
    present[rng.permutation(len(present))[:cells]] = True
    return CellBlock(
        version=VERSION,
        shape=shape,
        reference=(1.5, -2.25, 1.0, 0.0, 0.125, -3.0),
        present=present.reshape(shape),
        values=rng.integers(0, 256 if coded else LEVELS + 1, (wide, cells)).astype(np.uint8),
        coded=coded,
    )


def decode(payload: bytes, shape: tuple[int, int] = (6, 7)) -> CellBlock:
    return decode_cells(payload, VERSION, shape, CHANNELS, PARTS)


@st.composite
def blocks(draw: st.DrawFn) -> CellBlock:
    shape = draw(st.tuples(st.integers(1, 40), st.integers(1, 40)))
    area = shape[0] * shape[1]
    return block(
        shape,
        draw(st.one_of(st.integers(0, area), st.sampled_from((0, 1, area)))),
        draw(st.integers(1, 9)),
        draw(st.booleans()),
        draw(st.integers(0, 1000)),
    )


@given(blocks())
def test_what_is_encoded_is_decoded(sent: CellBlock) -> None:
    wide = len(sent.values)
    # Only the number that the kind needs is right.
    channels, parts = (99, wide) if sent.coded else (wide, 99)
    got = decode_cells(encode_cells(sent), sent.version, sent.shape, channels, parts)
    assert (got.version, got.shape, got.reference) == (sent.version, sent.shape, sent.reference)
    assert got.coded == sent.coded
    assert got.present.dtype == np.bool_
    assert np.array_equal(got.present, sent.present)
    assert got.values.dtype == np.uint8
    assert np.array_equal(got.values, sent.values)


def test_two_steps_share_a_byte_and_codes_take_one_each() -> None:
    steps, codes = block(cells=11), block(cells=11, wide=PARTS, coded=True)
    for sent, size in ((steps, 28), (codes, 33)):
        kind, body = unseal(encode_cells(sent))
        *_, count, places = HEAD.unpack_from(body)
        assert kind == (KIND_CODES if sent.coded else KIND_STEPS)
        assert count == 11
        assert len(zlib.decompress(body[HEAD.size + places :])) == size


def test_few_cells_of_a_large_map_take_few_bytes() -> None:
    assert len(encode_cells(block((128, 128), 100, 32))) < 100 * 16 + 400


@pytest.mark.parametrize("coded", [False, True])
def test_every_truncated_payload_is_refused(coded: bool) -> None:
    payload = encode_cells(block(wide=PARTS if coded else CHANNELS, coded=coded))
    kind, body = unseal(payload)
    for length in range(len(payload)):
        with pytest.raises(PayloadError):
            decode(payload[:length])
    for length in range(len(body)):
        with pytest.raises(PayloadError):
            decode(seal(kind, body[:length]))


def test_every_damaged_byte_is_noticed() -> None:
    payload = encode_cells(block())
    for at in range(len(payload)):
        damaged = bytearray(payload)
        damaged[at] ^= 0x10
        with pytest.raises(PayloadError):
            decode(bytes(damaged))


@given(
    st.booleans(),
    st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from((KIND_STEPS, KIND_CODES)),
)
def test_a_mutation_with_a_right_checksum_is_refused_or_is_a_map(
    coded: bool, changes: list[tuple[int, int]], kind: int
) -> None:
    _, body = unseal(encode_cells(block(wide=PARTS if coded else CHANNELS, coded=coded)))
    mutated = bytearray(body)
    for at, value in changes:
        mutated[at % len(mutated)] = value
    assert_refused_or_map(seal(kind, bytes(mutated)))


@given(st.binary(max_size=80), st.binary(max_size=80), st.integers(0, 50), st.integers(0, 40))
def test_parts_of_any_content_are_refused_or_are_a_map(
    places: bytes, values: bytes, count: int, length: int
) -> None:
    head = HEAD.pack(VERSION, 6, 7, *([0.0] * 6), count, length)
    for kind in (KIND_STEPS, KIND_CODES):
        assert_refused_or_map(seal(kind, head + places + values))
        squeezed = zlib.compress(places)
        head_right = HEAD.pack(VERSION, 6, 7, *([0.0] * 6), count, len(squeezed))
        assert_refused_or_map(seal(kind, head_right + squeezed + zlib.compress(values)))


def assert_refused_or_map(payload: bytes) -> None:
    try:
        got = decode(payload)
    except PayloadError:
        return
    assert got.present.shape == (6, 7)
    assert got.values.shape == (PARTS if got.coded else CHANNELS, int(got.present.sum()))
    assert got.coded or got.values.max(initial=0) <= LEVELS
    assert np.isfinite(got.reference).all()


def test_a_map_of_other_weights_is_refused_with_both_versions() -> None:
    payload = encode_cells(replace(block(), version=0x1234))
    with pytest.raises(PayloadError, match=r"00001234.*deadbeef"):
        decode(payload)


@pytest.mark.parametrize("shape", [(7, 6), (6, 8), (60, 70), (1, 42)])
def test_a_map_of_another_grid_is_refused_with_both_sizes(shape: tuple[int, int]) -> None:
    with pytest.raises(PayloadError, match=rf"{shape[0]} x {shape[1]} cells, not \(6, 7\)"):
        decode(encode_cells(block(shape)))


@pytest.mark.parametrize("count", [0, 10, 12, 43, 2**32 - 1])
def test_another_number_of_cells_than_announced_is_refused(count: int) -> None:
    kind, body = unseal(encode_cells(block(cells=11)))
    *head, _, length = HEAD.unpack_from(body)
    with pytest.raises(PayloadError, match=f"announces {count} cells"):
        decode(seal(kind, HEAD.pack(*head, count, length) + body[HEAD.size :]))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_reference_that_is_no_place_is_refused(bad: float) -> None:
    with pytest.raises(PayloadError, match="around"):
        decode(encode_cells(replace(block(), reference=(0.0, bad, 0.0, 0.0, 0.0, 0.0))))


@pytest.mark.parametrize("kind", [0, 1, 16, 31, 36, 255])
def test_another_kind_of_payload_is_refused(kind: int) -> None:
    _, body = unseal(encode_cells(block()))
    with pytest.raises(PayloadError, match=f"kind {kind} is not a feature map"):
        decode(seal(kind, body))


@pytest.mark.parametrize("part", ["places", "values"])
def test_what_inflates_to_more_than_announced_is_not_inflated(part: str) -> None:
    kind, body = unseal(encode_cells(block()))
    *head, count, length = HEAD.unpack_from(body)
    places, values = body[HEAD.size : HEAD.size + length], body[HEAD.size + length :]
    bomb = zlib.compress(bytes(50_000_000), 9)
    if part == "places":
        places = bomb
    else:
        values = bomb
    payload = seal(kind, HEAD.pack(*head, count, len(places)) + places + values)
    tracemalloc.start()
    try:
        with pytest.raises(PayloadError, match=f"{part} does not decompress"):
            decode(payload)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_nothing_may_follow_the_values() -> None:
    kind, body = unseal(encode_cells(block()))
    with pytest.raises(PayloadError):
        decode(seal(kind, body + b"x"))


@pytest.mark.parametrize("coded", [False, True])
def test_a_payload_tells_what_its_map_was_computed_in(coded: bool) -> None:
    plain = block(coded=coded, wide=PARTS if coded else CHANNELS)
    short = replace(plain, numerics="bfloat16")
    assert decode(encode_cells(plain)).numerics == "float32"
    assert decode(encode_cells(short)).numerics == "bfloat16"
    # As it was before payloads told, for a map in float32.
    assert unseal(encode_cells(plain))[0] == (KIND_CODES if coded else KIND_STEPS)
    assert unseal(encode_cells(short))[1] == unseal(encode_cells(plain))[1]
