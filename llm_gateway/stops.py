"""Where an answer ends by the client's own `stop` sequences, which are no part of it."""

from __future__ import annotations

from collections.abc import Sequence


def before_stop(text: str, stops: Sequence[str]) -> tuple[str, bool]:
    """What stands before the stop sequence that is complete first, at which a model would have been
    stopped, and whether there is one."""
    begins = ((text.find(stop), len(stop)) for stop in stops)
    ends = [(begin + length, begin) for begin, length in begins if begin >= 0]
    return (text[: min(ends)[1]], True) if ends else (text, False)


class Telling:
    """Tells an answer piece by piece, but nothing that may turn out to belong to a stop sequence.

    >>> telling = Telling(("END",))
    >>> [telling.take(piece) for piece in ("one E", "N", "d two ", "END three")]
    ['one ', '', 'ENd two ', '']
    """

    def __init__(self, stops: Sequence[str]) -> None:
        self._stops = stops
        self._held = ""
        self._stopped = False

    def take(self, piece: str) -> str:
        """What can be told now that `piece` has come."""
        text, stopped = before_stop(self._held + piece, self._stops)
        if self._stopped:
            return ""
        self._stopped = stopped
        held = 0 if stopped else self._doubtful(text)
        self._held = text[len(text) - held :]
        return text[: len(text) - held]

    def _doubtful(self, text: str) -> int:
        """How many of the last characters may be the beginning of a stop sequence."""
        longest = max(map(len, self._stops), default=1) - 1
        for size in range(min(longest, len(text)), 0, -1):
            if any(stop.startswith(text[-size:]) for stop in self._stops):
                return size
        return 0
