"""Places at a server are shared among those who ask."""

from __future__ import annotations

import threading
import time

from hypothesis import given
from hypothesis import strategies as st

from swarm.places import Places


def places(limit: int = 4, each: int = 1, *, newest_first: bool = True) -> Places[int]:
    return Places(limit, each, newest_first=newest_first)


def test_who_has_the_most_gives_way() -> None:
    held = places()
    for number in range(4):
        assert held.add("stranger", number) is None
    assert held.add("ego", 10) == 0
    assert held.add("ego", 11) == 1
    # As many each: the oldest goes, and it is the newest that counts.
    assert held.add("ego", 12) == 10
    assert held.add("stranger", 4) == 2


def test_the_newest_goes_where_the_order_counts() -> None:
    held = places(newest_first=False)
    for number in range(4):
        assert held.add("stranger", number) is None
    assert held.add("stranger", 4) == 4
    assert held.add("ego", 10) == 0


def test_many_names_with_one_place_each_do_not_keep_one_more_out() -> None:
    held = places()
    for number in range(4):
        assert held.add(f"name{number}", number) is None
    assert held.add("ego", 10) == 0


def test_what_is_being_answered_is_never_taken_away() -> None:
    held = places(limit=2, each=2)
    assert held.add("stranger", 0) is None
    assert held.add("stranger", 1) is None
    assert held.next() == ("stranger", 1)
    assert held.next() == ("stranger", 0)
    assert held.add("ego", 10) == 10
    held.done("stranger")
    assert held.add("ego", 11) is None


def test_the_asker_for_whom_the_least_is_done_comes_first() -> None:
    held = places(each=2)
    for number in range(3):
        held.add("stranger", number)
    assert held.next() == ("stranger", 2)
    held.add("ego", 10)
    assert held.wanted("stranger")
    assert held.next() == ("ego", 10)
    assert not held.wanted("stranger")
    assert held.wanted("ego")
    assert held.next() == ("stranger", 1)
    assert held.next() is None
    held.done("stranger")
    assert held.next() == ("stranger", 0)


def test_of_those_for_whom_as_much_is_done_the_earliest_deadline_comes_first() -> None:
    held = places(limit=8, each=2)
    held.add("patient", 0, 9.0)
    held.add("hasty", 10, 2.0)
    held.add("whenever", 20)
    held.add("patient", 1, 9.5)
    assert held.ahead() == 4
    # An asker's own: the newest, for which its older one is out of date.
    assert [held.next() for _ in range(4)] == [
        ("hasty", 10),
        ("patient", 1),
        ("whenever", 20),
        ("patient", 0),
    ]
    assert held.ahead() == 4


def test_deadlines_do_not_overtake_where_the_order_counts() -> None:
    held = places(each=2, newest_first=False)
    held.add("a", 0, 5.0)
    held.add("a", 1, 1.0)
    held.add("b", 10, 3.0)
    assert [held.next() for _ in range(3)] == [("b", 10), ("a", 0), ("a", 1)]


def test_who_may_not_be_answered_now_is_not_waited_for() -> None:
    held = places(limit=8, each=2)
    for number in range(3):
        held.add("a", number)
    held.add("b", 10)
    assert [held.next() for _ in range(3)] == [("b", 10), ("a", 2), ("a", 1)]
    # Another thread would not help: two of a's are under way.
    assert not held.wanted("b")
    held.done("a")
    assert held.wanted("b")


def test_drained_places_take_nothing_and_wait_for_what_they_have() -> None:
    held = places()
    held.add("ego", 1)
    assert held.next() == ("ego", 1)
    assert not held.drain(time.monotonic())
    assert held.add("ego", 2) == 2
    ending = threading.Timer(0.05, held.done, ("ego",))
    ending.start()
    assert held.drain(time.monotonic() + 20.0)
    ending.join()


@given(
    st.integers(1, 5),
    st.integers(1, 3),
    st.booleans(),
    st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=60),
)
def test_every_query_is_answered_once_or_goes_once(
    limit: int, each: int, newest_first: bool, steps: list[tuple[str, bool]]
) -> None:
    held = places(limit, each, newest_first=newest_first)
    gone: list[int] = []
    answered: list[int] = []
    under_way: list[str] = []
    for number, (asker, adds) in enumerate(steps):
        if adds:
            loser = held.add(asker, number)
            gone += [] if loser is None else [loser]
        elif (found := held.next()) is not None:
            under_way.append(found[0])
            answered.append(found[1])
            assert under_way.count(found[0]) <= each
        elif under_way:
            held.done(under_way.pop(0))
    while under_way:
        held.done(under_way.pop())
        while (found := held.next()) is not None:
            under_way.append(found[0])
            answered.append(found[1])
    while (found := held.next()) is not None:
        answered.append(found[1])
        held.done(found[0])
    asked = [number for number, (_, adds) in enumerate(steps) if adds]
    assert sorted(gone + answered) == asked
