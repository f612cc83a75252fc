"""From shapes to the lines of `tc`, and from its output to readings."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from network_controller import ladder
from network_controller.drivers import htb
from network_controller.drivers.readings import filters, parse, rate_bps, size_bytes
from network_controller.model import Queue
from swarm.messages.net import MAX_RATE_BPS, MIN_RATE_BPS
from swarm.traffic import TrafficClass

rates = st.integers(MIN_RATE_BPS, MAX_RATE_BPS)
levels = st.integers(0, ladder.TOP)


def lines(rate_bps: int, level: int = 0, delay_ms: float = 0.0, loss: float = 0.0) -> list[str]:
    shape = ladder.shape(rate_bps, level, delay_ms=delay_ms, loss=loss)
    return htb.lines("dev0", shape, shaped=False, fq_codel=False)


def numbers(text: list[str], word: str) -> list[int]:
    return [int(n) for line in text for n in re.findall(rf" {word} (\d+)", line)]


@given(rate=rates, level=levels)
def test_every_class_has_a_bucket_for_two_packets_and_a_quantum_that_htb_takes(
    rate: int, level: int
) -> None:
    text = lines(rate, level)
    assert all(n >= 2 * 1514 for n in numbers(text, "c?burst"))
    quanta = numbers(text, "quantum")
    assert len(set(quanta)) == 1, "classes of one priority share the rest in equal parts"
    assert 1514 <= quanta[0] <= 60_000


@given(rate=rates, level=levels)
def test_guarantees_never_exceed_the_capacity(rate: int, level: int) -> None:
    classes = ladder.shape(rate, level).classes.values()
    assert sum(c.rate_bps for c in classes) <= rate
    assert all(c.ceil_bps == rate for c in classes)


def test_a_change_touches_neither_the_root_nor_the_filters() -> None:
    changed = htb.lines("dev0", ladder.shape(5_000_000, 1), shaped=True, fq_codel=False)
    assert not [line for line in changed if line.startswith("filter") or " root " in line]


@given(rate=rates, level=levels, slot=st.integers(1, htb.MAX_SLOTS))
def test_a_slot_of_a_tree_has_its_guarantee_and_borrows_up_to_its_ceiling(
    rate: int, level: int, slot: int
) -> None:
    shape = ladder.shape(rate, level, ceil_bps=2 * rate, cell_bps=3 * rate)
    text = htb.root_lines("ifb0", shape, shaped=False)
    text += htb.slot_lines("ifb0", shape, slot, "10.0.0.7", shaped=False, fq_codel=False)
    classes = [line for line in text if line.startswith("class ")]
    root, _, own, *leaves = classes
    assert f"rate {3 * rate}bit ceil {3 * rate}bit" in root
    assert f"parent 1:1 classid 1:{slot:x}00 htb rate {rate}bit ceil {2 * rate}bit" in own
    assert len(leaves) == 1 + len(TrafficClass), "bare acknowledgements have one, too"
    assert all(f"parent 1:{slot:x}00 " in one and f"ceil {2 * rate}bit" in one for one in leaves)
    assert sum(numbers(leaves, "rate")) <= rate
    assert len(set(numbers(classes, "quantum"))) == 1
    for name in (f"{slot:x}00", f"{slot:x}30"):
        assert htb.slot_of(name) == (slot, name[-2:])
    changed = htb.slot_lines("ifb0", shape, slot, "10.0.0.7", shaped=True, fq_codel=False)
    assert not [line for line in changed if line.startswith("filter")]


def test_delay_and_loss_take_the_place_of_the_plain_queue() -> None:
    text = "\n".join(lines(5_000_000, delay_ms=20.0, loss=0.01))
    assert text.count("netem delay 20ms loss 1%") == 4
    assert "bfifo" not in text


@pytest.mark.parametrize(("rate", "target_ms"), [(100_000_000, 5.0), (1_000_000, 18.2)])
def test_fq_codel_aims_at_no_less_than_a_packet_takes(rate: int, target_ms: float) -> None:
    text = htb.lines("dev0", ladder.shape(rate, 0), shaped=False, fq_codel=True)
    assert sum(f"fq_codel target {target_ms}ms" in line for line in text) == 4


@pytest.mark.parametrize(
    ("text", "bps"), [("5500K", 5_500_000), ("55M", 55_000_000), ("1G", 10**9), ("8", 8)]
)
def test_rates_are_read_in_tcs_words(text: str, bps: int) -> None:
    assert rate_bps(text) == bps


def test_sizes_are_read_in_tcs_words() -> None:
    assert [size_bytes(t) for t in ("0", "1514", "12K", "3M")] == [0, 1514, 12288, 3145728]


SHOWN = """\
qdisc htb 1: root refcnt 2 r2q 10 default 0x30 direct_packets_stat 0 direct_qlen 1000
 Sent 9 bytes 1 pkt (dropped 0, overlimits 7 requeues 0)
 backlog 0b 0p requeues 0
qdisc fq_codel 8001: parent 1:20 limit 10240p flows 1024
 Sent 9 bytes 1 pkt (dropped 5, overlimits 0 requeues 0)
 backlog 0b 0p requeues 0
qdisc netem 8002: parent 1:30 limit 1000 delay 20ms loss 1%
 Sent 9 bytes 1 pkt (dropped 0, overlimits 0 requeues 0)
 backlog 0b 0p requeues 0
class htb 1:1 root rate 5500Kbit ceil 5500Kbit burst 13750b cburst 13750b
 Sent 9 bytes 1 pkt (dropped 0, overlimits 3 requeues 0)
 backlog 0b 0p requeues 0
class htb 1:20 parent 1:1 leaf 8001: prio 1 rate 1375Kbit ceil 5500Kbit burst 3437b cburst 13750b
 Sent 123456 bytes 99 pkt (dropped 2, overlimits 4 requeues 0)
 backlog 12Kb 8p requeues 0
"""


def test_readings_are_of_the_device_whose_turn_it_is() -> None:
    none = "qdisc noqueue 0: root refcnt 2\n Sent 0 bytes 0 pkt (dropped 0, overlimits 0 x)\n"
    found = parse(none + SHOWN, ["plain", "shaped"])
    assert set(found) == {Queue("shaped")}
    reading = found[Queue("shaped")]
    fusion = reading.classes[TrafficClass.FUSION]
    assert (reading.capacity_bps, reading.delay_ms, reading.loss) == (5_500_000, 20.0, 0.01)
    assert (fusion.shape.rate_bps, fusion.shape.ceil_bps, fusion.shape.priority) == (
        *(1_375_000, 5_500_000),
        1,
    )
    assert (fusion.sent_bytes, fusion.backlog_bytes, fusion.overlimits) == (123_456, 12_288, 4)


TREE = """\
qdisc htb 1: root refcnt 2 r2q 10 default 0x2 direct_packets_stat 0 direct_qlen 32
qdisc netem 8002: parent 1:210 limit 1000 delay 20ms
class htb 1:1 root rate 10Mbit ceil 10Mbit burst 25000b cburst 25000b
class htb 1:2 parent 1:1 prio 0 rate 8Kbit ceil 10Mbit burst 1600b cburst 1600b
class htb 1:100 parent 1:1 rate 4Mbit ceil 10Mbit burst 12500b cburst 25000b
class htb 1:120 parent 1:100 leaf 8026: prio 1 rate 1Mbit ceil 10Mbit burst 3200b cburst 25000b
 Sent 77 bytes 1 pkt (dropped 0, overlimits 0 requeues 0)
class htb 1:200 parent 1:1 rate 6Mbit ceil 7Mbit burst 12500b cburst 25000b
class htb 1:210 parent 1:200 leaf 8002: prio 0 rate 600Kbit ceil 7Mbit burst 3200b cburst 25000b
"""


def test_each_slot_of_a_tree_is_a_reading() -> None:
    found = parse(TREE, ["ifb0"])
    assert set(found) == {Queue("ifb0", 1), Queue("ifb0", 2)}
    one, two = found[Queue("ifb0", 1)], found[Queue("ifb0", 2)]
    assert (one.capacity_bps, one.cell_bps, one.delay_ms) == (4_000_000, 10_000_000, 0.0)
    assert (two.capacity_bps, two.cell_bps, two.delay_ms) == (6_000_000, 10_000_000, 20.0)
    assert one.classes[TrafficClass.FUSION].sent_bytes == 77
    assert two.classes[TrafficClass.CONTROL].shape.ceil_bps == 7_000_000


RULES = """\
filter protocol ip pref 7 u32 chain 0 fh 800: ht divisor 1
filter protocol ip pref 7 u32 chain 0 fh 800::7ff order 2047 key bkt 0 *flowid 1:705 not_in_hw
  match 0a000007/ffffffff at 16
  match 05000000/0f00ff80 at 0
  match 00060000/00ff0000 at 8
  match 00100000/00ff0000 at 32
filter protocol ip pref 7 u32 chain 0 fh 800::800 order 2048 key bkt 0 *flowid 1:710 not_in_hw
  match 0a000007/ffffffff at 16
  match 00b80000/00fc0000 at 0
filter protocol ip pref 7 u32 chain 0 fh 800::801 order 2049 key bkt 0 *flowid 1:720 not_in_hw
  match 0a000007/ffffffff at 16
  match 00880000/00fc0000 at 0
filter protocol ip pref 7 u32 chain 0 fh 800::802 order 2050 key bkt 0 *flowid 1:730 not_in_hw
  match 0a000007/ffffffff at 16
"""


def test_filters_of_a_slot_are_told_from_others() -> None:
    to = htb.destination("10.0.0.7")
    assert filters(RULES) == htb.slot_filters(7, to)
    assert filters(RULES.replace("0088", "00b8")) != htb.slot_filters(7, to)


def test_drops_of_a_queue_that_drops_late_are_counted() -> None:
    reading = parse(SHOWN, ["shaped"])[Queue("shaped")]
    assert reading.classes[TrafficClass.FUSION].drops == 5


def test_counters_of_filters_are_not_taken_for_those_of_a_class() -> None:
    rule = (
        "filter protocol all pref 1 u32 chain 0 fh 800::800 order 2048 key ht 800 bkt 0\n"
        "  match 00000000/00000000 at 0\n"
        "\taction order 1: mirred (Egress Redirect to device ifb-link1) stolen\n"
        "\tAction statistics:\n"
        "\tSent 777 bytes 7 pkt (dropped 7, overlimits 7 requeues 0)\n"
        "\tbacklog 7b 0p requeues 0\n"
    )
    assert parse(SHOWN + rule, ["shaped"]) == parse(SHOWN, ["shaped"])
