"""The queue before the model: fair turns first, then the earliest deadline.

Clients take turns. A client's turn number is how many of its calls were started while it had more
to do; of the clients with the lowest one, the job with the earliest deadline goes first. A client
that comes (back) begins at the present turn, so that nobody saves up turns and nobody starves:
between two starts of one waiting client, another one that was there gets at most two.

When the queue is full, a newcomer may still displace a job: one of the client with the most
waiting jobs, and among equals the one with the latest deadline, as long as that is worse off than
the newcomer would be in the same comparison.
"""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar


class Waiter(Protocol):
    """What can wait; its deadline may move while it does."""

    client: str
    deadline: float


W = TypeVar("W", bound=Waiter)


class Waiting(Generic[W]):
    """At most `most` jobs, at most `per_client` of one client."""

    def __init__(self, most: int, per_client: int) -> None:
        self._most = most
        self._per_client = per_client
        self._jobs: dict[str, list[W]] = {}
        self._turns: dict[str, int] = {}
        self._turn = 0
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def refusal(self, job: W) -> tuple[str, W | None]:
        """Why there is no room for a job (empty where there is), and whom it would displace."""
        own = len(self._jobs.get(job.client, ()))
        if own >= self._per_client:
            return f"{own} requests of {job.client!r} are waiting, as many as one may have", None
        if self._size < self._most:
            return "", None
        worst = max(
            (other for jobs in self._jobs.values() for other in jobs),
            key=lambda other: (len(self._jobs[other.client]), other.deadline),
        )
        if (own + 1, job.deadline) < (len(self._jobs[worst.client]), worst.deadline):
            return "", worst
        return f"{self._size} requests are waiting, as many as may", None

    def put(self, job: W) -> None:
        """Adds a job for which `refusal` found room, after removing whom it displaces."""
        self._turns[job.client] = max(self._turns.get(job.client, 0), self._turn)
        self._jobs.setdefault(job.client, []).append(job)
        self._size += 1

    def pop(self) -> W:
        """Takes the job whose turn it is; there must be one."""
        job = min(
            (other for jobs in self._jobs.values() for other in jobs),
            key=lambda other: (self._turns[other.client], other.deadline),
        )
        self._turn = self._turns[job.client]
        self._turns[job.client] += 1
        self.remove(job)
        # Who is behind the present turn and does not wait would begin at it anyway.
        self._turns = {
            client: turn
            for client, turn in self._turns.items()
            if turn > self._turn or client in self._jobs
        }
        return job

    def remove(self, job: W) -> bool:
        """Forgets a job; returns whether it was waiting."""
        jobs = self._jobs.get(job.client, [])
        # By identity: equal jobs are different ones.
        index = next((i for i, other in enumerate(jobs) if other is job), None)
        if index is None:
            return False
        del jobs[index]
        if not jobs:
            del self._jobs[job.client]
        self._size -= 1
        return True

    def clear(self) -> list[W]:
        """Takes all jobs."""
        jobs = [job for of_client in self._jobs.values() for job in of_client]
        self._jobs.clear()
        self._size = 0
        return jobs
