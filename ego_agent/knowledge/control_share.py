"""What robots may tell of themselves on a link: their beacons and scene descriptions."""

from __future__ import annotations

FULL_BPS = 120_000
"""Of one robot that is free to speak: ten beacons and two scenes a second of a crowded floor."""
NEEDED_BPS = 8_000
"""With less a robot's beacons are older than a second before the next one comes."""
WELL_BPS = 10_000
"""With this a beacon that is lost or late is followed by the next one within the second."""
SHARE = 0.2
"""Of C(t) for all robots' messages: what observations leave free."""
WELL_SHARE = 0.4
"""Of C(t), where the robots need more than SHARE to be known well."""
MOST_SHARE = 0.8
"""Of C(t), where the robots need more than SHARE to be known at all."""
_ROUNDS = 32
"""Until it settles: each step is smaller than the one before by a fifth or more."""


def carried_bps(each_bps: float) -> float:
    """bit/s that one robot may take, where C(t) has that much for each."""
    return max(
        SHARE * each_bps,
        min(WELL_BPS, WELL_SHARE * each_bps),
        min(NEEDED_BPS, MOST_SHARE * each_bps),
    )


def control_bps(link_bps: float, robots: int) -> float:
    """bit/s that the others' messages take of an ego's link once they keep to what they may; of so
    many robots, the ego among them. What fusion has is what they leave."""
    taken = 0.0
    for _ in range(_ROUNDS):
        each_bps = max(0.0, link_bps - taken) / max(1, robots)
        taken = max(0, robots - 1) * min(FULL_BPS, carried_bps(each_bps))
    return taken
