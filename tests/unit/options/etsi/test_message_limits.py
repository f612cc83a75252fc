"""Collective Perception Messages: what is known of them without ETSI's modules."""

from __future__ import annotations

import pytest

from options.etsi.message import EPOCH_MS, LEAP_MS, MAX_OBJECTS, Cpm, Told, decode, encode
from swarm.errors import PayloadError


def test_more_objects_than_a_message_holds_are_named() -> None:
    forklift = Told(1, "forklift", (1.0, -5.6, 0.5), (2.5, 1.2, 2.1), 0.7, (1.5, -0.2), 0.9, 0.05)
    message = Cpm(7, 1_800_000_000_123, 48.8, 2.4, 1.0, (forklift,) * (MAX_OBJECTS + 1))
    with pytest.raises(PayloadError, match=f"{MAX_OBJECTS + 1} objects"):
        encode(message)
    with pytest.raises(PayloadError, match="allowed: 65536"):
        decode(bytes(70_000))


def test_the_time_of_its_begins_with_2004_and_counts_leap_seconds() -> None:
    # TS 102 894-2: 2007-01-01T00:00:00.000Z is 94 694 401 000, one leap second after 2004.
    assert 1_167_609_600_000 - EPOCH_MS + 1_000 == 94_694_401_000
    assert LEAP_MS == 5_000
