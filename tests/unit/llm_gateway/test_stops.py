"""Stop sequences: where an answer ends, however it comes."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from llm_gateway.stops import Telling, before_stop

LETTERS = st.text("ab\n", max_size=12)
STOPS = st.lists(st.text("ab\n", min_size=1, max_size=4), max_size=4)


def test_the_stop_sequence_that_is_complete_first_counts() -> None:
    assert before_stop("one;two\nthree", ("\n", ";")) == ("one", True)
    assert before_stop("one", ("\n",)) == ("one", False)
    assert before_stop("one", ()) == ("one", False)
    # Whoever writes it letter by letter is stopped at the line's end.
    assert before_stop("b\nb", ("\n", "b\nb")) == ("b", True)


@given(pieces=st.lists(LETTERS), stops=STOPS)
@example(pieces=["b", "\n", "b"], stops=["\n", "b\nb"])
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
