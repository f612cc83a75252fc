"""Collective Perception Messages: bytes that asn1c's decoder took, and what is read of others'."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import pytest

from options.etsi import modules
from options.etsi.message import EPOCH_MS, LEAP_MS, MAX_OBJECTS, Cpm, Told, decode, encode
from research.evaluation.ways.etsi import message_bytes
from swarm.errors import PayloadError, SettingError


def _has_all() -> bool:
    try:
        import asn1tools  # noqa: F401
    except ModuleNotFoundError:
        return False
    return modules.are_there()


needs_modules = pytest.mark.skipif(
    not _has_all(), reason="asn1tools, or ETSI's modules are missing: coadapt cpm modules"
)
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


@pytest.mark.peer
@needs_modules
def test_a_message_is_the_bytes_that_another_implementation_takes() -> None:
    assert encode(MESSAGE) == GOLDEN


@pytest.mark.peer
@needs_modules
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


@pytest.mark.peer
@needs_modules
def test_what_is_beyond_a_field_is_told_as_its_limit() -> None:
    far = Told(70_000, "car", (9999.0, -9999.0, 0.0), (99.0, 0.0, 2.0), 7.0, (999.0, 0.0), 2.0, 9.0)
    (read,) = decode(encode(replace(MESSAGE, objects=(far,)))).objects
    assert read.center == (1310.71, -1310.72, 0.0)
    assert read.size == (25.4, 0.1, 2.0)
    assert read.velocity == (163.82, 0.0)
    assert (read.id, read.score, read.age_s) == (70_000 % 65_536, 1.0, 2.048)
    assert read.heading == pytest.approx(7.0 - math.tau, abs=math.radians(0.05))


@pytest.mark.peer
@needs_modules
@pytest.mark.parametrize("raw", [b"", b"\0" * 40, GOLDEN[:60], b"\xff" * 300, GOLDEN[:2]])
def test_what_is_no_message_is_named(raw: bytes) -> None:
    with pytest.raises(PayloadError):
        decode(raw)


@pytest.mark.peer
@needs_modules
def test_bytes_of_a_message_follow_from_its_labels() -> None:
    for label in ("forklift", "car", "truck", "person", "robot"):
        for count in (0, 1, 2, 3, 4, 5, 17, 62, 200):
            objects = (replace(FORKLIFT, label=label),) * count
            raw = encode(replace(MESSAGE, objects=objects))
            assert len(raw) == message_bytes([label] * count), (label, count)


def test_more_objects_than_a_message_holds_are_named() -> None:
    with pytest.raises(PayloadError, match=f"{MAX_OBJECTS + 1} objects"):
        encode(replace(MESSAGE, objects=(FORKLIFT,) * (MAX_OBJECTS + 1)))
    with pytest.raises(PayloadError, match="allowed: 65536"):
        decode(bytes(70_000))


def test_the_time_of_its_begins_with_2004_and_counts_leap_seconds() -> None:
    # TS 102 894-2: 2007-01-01T00:00:00.000Z is 94 694 401 000, one leap second after 2004.
    assert 1_167_609_600_000 - EPOCH_MS + 1_000 == 94_694_401_000
    assert LEAP_MS == 5_000


class TestModules:
    def test_another_file_than_expected_is_refused(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("COADAPT_DATA", str(tmp_path / "data"))
        source = tmp_path / "source"
        for name in modules.FILES:
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_text("DEFINITIONS")
        with pytest.raises(SettingError, match="is another file than expected: SHA-256"):
            modules.bring(source.as_uri())
        assert not modules.folder().exists()
        assert not modules.are_there()

    def test_what_cannot_be_had_says_what_to_do(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("COADAPT_DATA", str(tmp_path))
        with pytest.raises(SettingError, match="Where there is no network, bring the folder"):
            modules.bring((tmp_path / "nowhere").as_uri())

    def test_right_files_are_put_in_place_once(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("COADAPT_DATA", str(tmp_path / "data"))
        (tmp_path / "a.asn").write_text("A")
        files = {"a.asn": hashlib.sha256(b"A").hexdigest()}
        monkeypatch.setattr(modules, "FILES", files)
        folder = modules.bring(tmp_path.as_uri())
        assert (folder / "a.asn").read_text() == "A"
        assert modules.are_there()
        # Nothing is brought again.
        assert modules.bring("file:///nowhere") == folder

    def test_modules_of_another_make_are_named(self) -> None:
        with pytest.raises(SettingError, match="0 times in the modules; expected: once"):
            modules.said_otherwise(["A DEFINITIONS ::= BEGIN END"])
