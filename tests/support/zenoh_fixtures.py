"""A real Zenoh router as a process, sessions on it, and waiting for what they bring."""

from __future__ import annotations

import queue
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Generic, TypeVar

import pytest

from swarm.session import Session
from tests.support.free_ports import free_ports

T = TypeVar("T")
WAIT_S = 20.0


def until(condition: Callable[[], bool], what: str, timeout_s: float = WAIT_S) -> None:
    """Waits for a state that no event announces."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"not within {timeout_s} s: {what}"
        time.sleep(0.02)


def wait_until_served(asker: Session, key: str) -> None:
    """Asks without a payload, which no handler sees, until the queryable on a key refuses that:
    it takes a moment to reach the asker."""
    until(
        lambda: any(asker._connection.zenoh.get(key, payload=b"", timeout=WAIT_S)),
        f"{key} is served",
    )


class Inbox(Generic[T]):
    """What callbacks brought, to be awaited."""

    def __init__(self) -> None:
        self._items: queue.Queue[T] = queue.Queue()

    def put(self, item: T) -> None:
        self._items.put(item)

    def next(self, timeout_s: float = WAIT_S) -> T:
        return self._items.get(timeout=timeout_s)

    def next_where(self, condition: Callable[[T], bool], timeout_s: float = WAIT_S) -> T:
        deadline = time.monotonic() + timeout_s
        while True:
            item = self._items.get(timeout=max(0.001, deadline - time.monotonic()))
            if condition(item):
                return item

    def skip(self) -> None:
        """Looks only at what comes from now on."""
        while not self.empty():
            self._items.get()

    def empty(self) -> bool:
        return self._items.empty()


class RouterProcess:
    """`python -m swarm.router` on free ports of the loopback interface."""

    def __init__(self, *options: str) -> None:
        self._options = options
        self.port = free_ports(3)
        self.address = f"tcp/127.0.0.1:{self.port}"
        self._process: subprocess.Popen[str] | None = None
        self.start()

    def start(self) -> None:
        """Returns when it serves."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "swarm.router", "--port", str(self.port), *self._options],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._process.stderr is not None
        first = self._process.stderr.readline()
        assert "router_up" in first, first

    def says(self, words: str) -> None:
        """Waits for a line of its log with these words."""
        assert self._process is not None
        assert self._process.stderr is not None
        while words not in (line := self._process.stderr.readline()):
            assert line, f"the router ended without saying {words!r}"

    def stop(self, *, kill: bool = False) -> None:
        if self._process is None:
            return
        process, self._process = self._process, None
        # Leaving the block closes the pipe and waits for the process, whatever happens.
        with process:
            process.kill() if kill else process.terminate()
            try:
                process.wait(WAIT_S)
            finally:
                process.kill()


SessionMaker = Callable[..., Session]


@pytest.fixture(scope="session")
def shared_router() -> Iterator[RouterProcess]:
    """A router that many tests use; a swarm name of its own keeps a test apart."""
    router = RouterProcess()
    yield router
    router.stop()


@pytest.fixture
def own_router() -> Iterator[RouterProcess]:
    """A router that the test may stop and start."""
    router = RouterProcess()
    yield router
    router.stop()


@pytest.fixture
def swarm_name(request: pytest.FixtureRequest) -> str:
    """A swarm for this test only."""
    return f"t{abs(hash(request.node.nodeid)):x}"[:32]


@pytest.fixture
def open_session(swarm_name: str) -> Iterator[SessionMaker]:
    """Opens sessions of this test's swarm, and closes them after it."""
    with ExitStack() as stack:

        def make(router: str, **options: object) -> Session:
            options.setdefault("timeout_s", 10.0)
            return stack.enter_context(Session(router, swarm_name, **options))  # type: ignore[arg-type]

        yield make


@pytest.fixture
def pair(shared_router: RouterProcess, open_session: SessionMaker) -> tuple[Session, Session]:
    """Two sessions of one swarm on the shared router."""
    return open_session(shared_router.address), open_session(shared_router.address)
