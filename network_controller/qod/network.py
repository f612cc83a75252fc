"""What the API needs of the controller."""

from __future__ import annotations

from typing import Protocol


class Network(Protocol):
    """The links of one swarm. Any thread may call; a call may wait for the kernel."""

    def robot_at(self, ipv4: str) -> str | None:
        """Whose link has this address, or None for nobody's. Raises NetworkError."""
        ...

    def capacity_bps(self, robot: str) -> int | None:
        """Capacity of a robot's link downwards; None where it is not shaped, so that nothing can
        be promised on it. Raises NetworkError."""
        ...

    def hold(self, session_id: str, robot: str, level: int) -> None:
        """Keeps a robot's link downwards at this level of the ladder or above, until `release`.

        Raises NetworkError, and then nothing is held.
        """
        ...

    def release(self, session_id: str) -> None:
        """Ends a hold; nothing happens when there is none (any more)."""
        ...
