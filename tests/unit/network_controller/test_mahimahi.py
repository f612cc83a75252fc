"""Recorded capacity in Mahimahi's format."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from network_controller.mahimahi import PACKET_BYTES, read_trace
from swarm.errors import NetworkError
from worlds.sample import data_folder

BITS = PACKET_BYTES * 8


def write(directory: Path, *times: object, end: str = "\n") -> Path:
    path = directory / "trace.down"
    path.write_text("".join(f"{time}{end}" for time in times))
    return path


def test_each_interval_has_the_packets_of_its_time(tmp_path: Path) -> None:
    path = write(tmp_path, 0, 0, 500, 1000, 1001, 2500, 2500, 2500, 3000)
    assert read_trace(path) == (4 * BITS, 1 * BITS, 4 * BITS)


def test_an_outage_is_an_interval_of_nothing(tmp_path: Path) -> None:
    assert read_trace(write(tmp_path, 1000, 3000)) == (BITS, 0, BITS)


def test_shorter_intervals_show_more(tmp_path: Path) -> None:
    path = write(tmp_path, 100, 300, 300, 500)
    assert read_trace(path, 0.1) == (10 * BITS, 0, 20 * BITS, 0, 10 * BITS)


def test_a_last_interval_that_the_trace_half_fills_counts_for_as_long_as_it_lasts(
    tmp_path: Path,
) -> None:
    assert read_trace(write(tmp_path, 1000, 1250, 1500)) == (BITS, 4 * BITS)


def test_a_last_interval_of_a_few_milliseconds_is_left_out(tmp_path: Path) -> None:
    assert read_trace(write(tmp_path, 1000, 1002, 1002)) == (BITS,)


def test_a_trace_shorter_than_an_interval_is_one_interval(tmp_path: Path) -> None:
    assert read_trace(write(tmp_path, 100, 200), 10.0) == (10 * BITS,)


def test_lines_of_other_systems_are_read(tmp_path: Path) -> None:
    path = tmp_path / "trace"
    path.write_bytes(b"500\r\n1000\r\n2000")
    assert read_trace(path) == (2 * BITS, BITS)


@given(
    gaps=st.lists(st.integers(0, 700), min_size=1, max_size=60).filter(any),
    interval_s=st.sampled_from([0.1, 0.3, 0.7, 1.0, 2.5]),
)
def test_no_packet_is_counted_twice_and_only_a_short_rest_is_left_out(
    gaps: list[int], interval_s: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    times = [sum(gaps[: i + 1]) for i in range(len(gaps))]
    rates = read_trace(write(tmp_path_factory.mktemp("t"), *times), interval_s)
    interval_ms = 1e3 * interval_s
    spans = [min(interval_ms, times[-1] - i * interval_ms) for i in range(len(rates))]
    counted = sum(rate * span / 1e3 / BITS for rate, span in zip(rates, spans, strict=True))
    left_out = sum(time > len(rates) * interval_ms + 1e-6 for time in times)
    assert counted == pytest.approx(len(times) - left_out, rel=1e-3)
    assert abs(len(rates) * interval_ms - times[-1]) <= interval_ms / 2 + 1e-6 or (
        len(rates) == 1 and times[-1] < interval_ms
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("0\n0\n", "ends at 0 ms after 2 lines"),
        ("1\n2.5\n", "line 2 is '2.5'; it must be a whole number of milliseconds"),
        ("1\n-2\n", "line 2 is '-2'"),
        ("1\n\n3\n", "line 2 is ''"),
        ("1\n10\n9\n", "line 3 is 9, after 10: times must not go back"),
        ("1\nfive\n", "line 2 is 'five'"),
        ("1\n٣\n", "line 2 is "),
        ("1\n99999999999\n", "line 2 is 99999999999; a trace may last 86400000 ms"),
        ("1\n" + "7" * 5000, "line 2 is '7777777"),
    ],
)
def test_what_is_no_trace_is_refused_with_its_line_and_value(
    text: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.down"
    path.write_text(text)
    with pytest.raises(NetworkError) as caught:
        read_trace(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("name", ["/dev/zero", "/nowhere/trace", "/"])
def test_what_cannot_be_read_is_refused(name: str) -> None:
    with pytest.raises(NetworkError, match=name):
        read_trace(Path(name))


@pytest.mark.parametrize("interval_s", [0.0, -1.0, 0.05, 3601.0, float("nan")])
def test_an_interval_that_no_request_may_have_is_refused(interval_s: float, tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match=r"allowed are 0\.1 to 3600 s"):
        read_trace(write(tmp_path, 1000), interval_s)


def test_more_intervals_than_a_request_carries_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="has 864000 intervals"):
        read_trace(write(tmp_path, 24 * 3600 * 1000), 0.1)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "seconds", "mean_bps"),
    [
        ("ATT-LTE-driving-2016.down", 120, 4_560_324),
        ("TMobile-UMTS-driving.down", 928, 2_019_707),
        ("Verizon-EVDO-driving.down", 1062, 520_501),
        ("Verizon-LTE-short.down", 140, 5_027_571),
    ],
)
def test_a_recorded_trace_keeps_its_length_and_its_mean(
    name: str, seconds: int, mean_bps: int
) -> None:
    root = data_folder(Path("traces"))
    path = root / name if root else None
    if path is None or not path.is_file():
        pytest.skip(f"no {name}: set COADAPT_DATA to a folder with traces/")
    rates = read_trace(path)
    assert len(rates) == seconds
    assert sum(rates) / len(rates) == pytest.approx(mean_bps, rel=1e-3)
