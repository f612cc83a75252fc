"""Stop sequences: where an answer ends, however it comes."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from llm_gateway.stops import Telling, before_stop

LETTERS = st.text("ab\n", max_size=12)
STOPS = st.lists(st.text("ab\n", min_size=1, max_size=4), max_size=4)


def test_the_first_of_several_stop_sequences_counts() -> None:
    assert before_stop("one;two\nthree", ("\n", ";")) == ("one", True)
    assert before_stop("one", ("\n",)) == ("one", False)
    assert before_stop("one", ()) == ("one", False)


@given(pieces=st.lists(LETTERS), stops=STOPS)
def test_what_is_told_is_the_beginning_of_the_answer(pieces: list[str], stops: list[str]) -> None:
    telling = Telling(stops)
    told = "".join(map(telling.take, pieces))
    answer, stopped = before_stop("".join(pieces), stops)
    assert answer.startswith(told)
    if stopped:
        assert told == answer
    else:
        # Only what may yet begin a stop sequence is held back.
        assert any(stop.startswith(answer[len(told) :]) for stop in stops) or told == answer
