"""Full packets that vanish while the other end is heard are told apart from a cut and from loss."""

from __future__ import annotations

import pytest

from swarm.tcp.info import TcpInfo
from swarm.tcp.stuck import HEARD_MS, STUCK_BACKOFF, stuck, why


def info(backoff: int, heard_ms: int) -> TcpInfo:
    return TcpInfo(1, True, 1, 0, backoff, 1448, heard_ms)


def test_what_does_not_get_through_is_told_with_how_to_look() -> None:
    fine, held = info(0, 10), info(STUCK_BACKOFF, 10)
    told = why([("10.0.0.1:7448", fine), ("10.0.0.1:7447", held)])
    assert told.startswith("packets of 1448 bytes do not get through to 10.0.0.1:7447")
    assert "`ping -M do -s 1448 10.0.0.1` tells" in told


@pytest.mark.parametrize(
    ("backoff", "heard_ms"), [(STUCK_BACKOFF - 1, 10), (STUCK_BACKOFF, HEARD_MS + 1), (0, 10)]
)
def test_a_loss_and_a_cut_are_none(backoff: int, heard_ms: int) -> None:
    assert why([("10.0.0.1:7447", info(backoff, heard_ms))]) == ""


def test_a_process_without_connections_has_nothing_that_is_stuck() -> None:
    assert stuck() == ""
