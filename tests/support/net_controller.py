"""A test that speaks as the network controller of an ego's cell."""

from __future__ import annotations

from collections.abc import Callable

from swarm import keyspace
from swarm.messages import Decision, LinkState, NetState
from swarm.session import Session
from tests.support.ego_swarm import MessageLog

EGO = "R1"


def cell(ego: str, available_bps: float, capacity_bps: float) -> LinkState:
    return LinkState(
        robot=ego,
        direction="down",
        capacity_bps=int(capacity_bps),
        available_bps=int(available_bps),
        latency_ms=0.0,
        level=0,
        classes={},
    )


class Controller:
    """Speaks for the ego's cell, once a decision, as a network controller does once a second."""

    def __init__(self, session: Session, decisions: MessageLog[Decision]) -> None:
        self._session = session
        self._decisions = decisions
        self._seq = 0

    def shape(self, bps: float, until: Callable[[Decision], bool]) -> list[Decision]:
        """Shapes the cell and goes on saying so; the decisions up to the first wanted one."""
        made: list[Decision] = []
        self._decisions.skip()
        while not made or not until(made[-1]):
            self._seq += 1
            links = (cell(EGO, bps, bps),)
            state = NetState(controller=7, seq=self._seq, sent_ns=0, links=links)
            self._session.put(keyspace.net_state("test"), state)
            made.append(self._decisions.until(lambda _: True))
            assert len(made) < 60, made[-1]
        return made
