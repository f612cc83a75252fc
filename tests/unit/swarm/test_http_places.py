"""How places are shared among those who connect."""

from __future__ import annotations

import pytest

from swarm.http.places import may_stay, origin


def fill(origins: list[str], places: int) -> list[str]:
    """Who has the places, when each in turn takes all that it can."""
    taken: list[str] = []
    for who in origins:
        while may_stay(who, taken, places):
            taken.append(who)
    return taken


@pytest.mark.parametrize("places", [2, 16, 100, 257])
def test_one_takes_half_of_the_places_at_most(places: int) -> None:
    assert len(fill(["a"], places)) == places // 2


def test_each_further_one_takes_half_of_what_is_left() -> None:
    taken = fill(["a", "b", "c"], 64)
    assert [taken.count(who) for who in "abc"] == [32, 16, 8]
    assert may_stay("newcomer", taken, 64)


def test_there_are_never_more_than_places() -> None:
    assert len(fill([str(number) for number in range(100)], 16)) < 16


def test_who_gives_places_back_may_take_them_again() -> None:
    taken = fill(["a"], 16)
    assert not may_stay("a", taken, 16)
    assert may_stay("a", taken[1:], 16)


def test_of_ipv6_a_network_is_one_origin() -> None:
    assert origin("2001:db8::1") == origin("2001:db8::ffff:2") != origin("2001:db8:0:1::1")
    assert origin("::ffff:192.0.2.1") == origin("192.0.2.1") != origin("192.0.2.2")
    assert origin("fe80::1%lo") == origin("fe80::2")
    assert origin("") == ""
