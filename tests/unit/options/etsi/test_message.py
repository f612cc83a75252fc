"""Collective Perception Messages: bytes that asn1c's decoder took, and what is read of others'."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from options.etsi import modules
from options.etsi.message import Cpm, Told, decode, encode
from research.evaluation.ways.etsi import message_bytes
from swarm.errors import PayloadError

pytestmark = pytest.mark.peer
pytest.importorskip("asn1tools", reason="asn1tools is missing: run make setup")
if not modules.are_there():
    pytest.skip("ETSI's modules are missing: coadapt cpm modules", allow_module_level=True)

FORKLIFT = Told(1, "forklift", (12.34, -5.6, 0.5), (2.5, 1.2, 2.1), 0.7, (1.5, -0.2), 0.9, 0.05)
MESSAGE = Cpm(
    station=7,
    unix_ms=1_800_000_000_123,
    latitude=48.8,
    longitude=2.4,
    orientation=1.0,
    objects=(
        FORKLIFT,
        replace(FORKLIFT, id=2, label="person"),
        replace(FORKLIFT, id=3, label="robot"),
        replace(FORKLIFT, id=4, label="car"),
    ),
)
GOLDEN = bytes.fromhex(
    "020e0000000702a52686b00e95d9980365c04007ffffff08eddd0f90030147fc4808602011a750000be7604d"
    "2fff7f743ffe0032fffa04afe7fd7f8191fc29f0bf8c7f80ab2d3a80009f3b02697ffbfba1fff00197ffd025"
    "7f3febfc0c8fe14f85fc63fc081b2d3a8000df3b02697ffbfba1fff00197ffd0257f3febfc0c8fe14f85fc63"
    "fc180d969d40008f9d8134bffdfdd0fff800cbffe812bf9ff5fe0647f0a7c2fe31fe016c80"
)
"""MESSAGE, as the C code that asn1c makes of the same modules (vanetza) decodes it, by field,
and encodes it again to the same bytes."""


def test_a_message_is_the_bytes_that_another_implementation_takes() -> None:
    assert encode(MESSAGE) == GOLDEN


def test_a_message_is_read_as_it_was_told() -> None:
    read = decode(GOLDEN)
    assert (read.station, read.unix_ms) == (7, 1_800_000_000_123)
    assert (read.latitude, read.longitude) == (48.8, 2.4)
    assert read.orientation == pytest.approx(1.0, abs=math.radians(0.05))
    assert [one.id for one in read.objects] == [1, 2, 3, 4]
    assert [one.label for one in read.objects] == ["forklift", "person", "other", "car"]
    for one in read.objects:
        assert one.center == FORKLIFT.center
        assert one.size == FORKLIFT.size
        assert one.velocity == FORKLIFT.velocity
        assert one.heading == pytest.approx(FORKLIFT.heading, abs=math.radians(0.05))
        assert one.score == pytest.approx(FORKLIFT.score, abs=1 / 30)
        assert one.age_s == 0.05


def test_what_is_beyond_a_field_is_told_as_its_limit() -> None:
    far = Told(70_000, "car", (9999.0, -9999.0, 0.0), (99.0, 0.0, 2.0), 7.0, (999.0, 0.0), 2.0, 9.0)
    (read,) = decode(encode(replace(MESSAGE, objects=(far,)))).objects
    assert read.center == (1310.71, -1310.72, 0.0)
    assert read.size == (25.4, 0.1, 2.0)
    assert read.velocity == (163.82, 0.0)
    assert (read.id, read.score, read.age_s) == (70_000 % 65_536, 1.0, 2.048)
    assert read.heading == pytest.approx(7.0 - math.tau, abs=math.radians(0.05))


@pytest.mark.parametrize("raw", [b"", b"\0" * 40, GOLDEN[:60], b"\xff" * 300, GOLDEN[:2]])
def test_what_is_no_message_is_named(raw: bytes) -> None:
    with pytest.raises(PayloadError):
        decode(raw)


def test_bytes_of_a_message_follow_from_its_labels() -> None:
    for label in ("forklift", "car", "truck", "person", "robot"):
        for count in (0, 1, 2, 3, 4, 5, 17, 62, 200):
            objects = (replace(FORKLIFT, label=label),) * count
            raw = encode(replace(MESSAGE, objects=objects))
            assert len(raw) == message_bytes([label] * count), (label, count)
