"""The gateway's side of the embedded model: asks a worker process, and starts it anew."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import signal
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from pathlib import Path

from llm_gateway.backends.llamacpp import frames, models
from llm_gateway.model import Hear, Prompt, Reply
from swarm.errors import GatewayError, SettingError
from swarm.log import Logger

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
"""Before a worker that ended is started again; doubles unless it had answered."""
STUCK_S = 30.0
"""A worker that does not even acknowledge a cancelled prompt for so long is ended."""
CLOSE_S = 2.0
_OUTPUT_LIMIT = 1 << 20


class LlamaCpp:
    """A model in llama.cpp, in a process of its own. Implements `Backend`."""

    name = "llamacpp"

    def __init__(
        self,
        model_path: Path,
        parallel: int,
        context: int,
        threads: int,
        log: Logger,
        *,
        cache: Path | None = None,
        adapter: Path | None = None,
    ) -> None:
        """`parallel` prompts at a time, each with its answer at most `context` tokens.

        `threads`: 0 takes all cores. `cache`: where a faster form of the model may be kept, by
        default in the user's cache folder. `adapter`: what was learned beside the model's weights.
        """
        self._path = model_path
        self._parallel = parallel
        self._context = context
        self._threads = threads
        self._log = log
        self._cache = cache or models.cache_folder()
        self._adapter = adapter
        self._idents = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[Reply]] = {}
        self._hearing: dict[int, Hear] = {}
        self._unacknowledged: dict[int, asyncio.TimerHandle] = {}
        self._process: Process | None = None
        self._ready = False
        self._state = "is not started"
        self._answered = False
        self._supervisor: asyncio.Task[None] | None = None
        self._first: asyncio.Future[None] | None = None

    @property
    def model(self) -> str:
        """The file's name without its ending."""
        return self._path.stem

    @property
    def parallel(self) -> int:
        """Sequences that the model's context holds."""
        return self._parallel

    @property
    def trouble(self) -> str:
        """Why the worker does not answer."""
        return "" if self._ready else f"the model's worker {self._state}"

    @property
    def pid(self) -> int | None:
        """Of the worker, while there is one."""
        return self._process.pid if self._process else None

    async def start(self) -> None:
        """Starts the worker and waits until it has answered once, or crashed.

        Raises SettingError where llama.cpp is not installed, or cannot load the file.
        """
        if not models.runtime_installed():
            raise SettingError(f"llama-cpp-python is not installed: {models.INSTALL}")
        self._first = asyncio.get_running_loop().create_future()
        self._supervisor = asyncio.create_task(self._supervise())
        try:
            await self._first
        except SettingError:
            await self.close()
            raise

    async def complete(self, prompt: Prompt, timeout_s: float, hear: Hear | None = None) -> Reply:
        """See Backend."""
        process = self._process
        if not self._ready or process is None or process.stdin is None:
            raise GatewayError("unavailable", f"the model's worker {self._state}")
        ident = next(self._idents)
        future: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._waiting[ident] = future
        if hear is not None:
            self._hearing[ident] = hear
        process.stdin.write(frames.pack(frames.Request(ident, prompt, words=hear is not None)))
        try:
            async with asyncio.timeout(timeout_s):
                return await future
        except TimeoutError:
            raise GatewayError("expired", f"no answer in {timeout_s:.1f} s") from None
        finally:
            del self._waiting[ident]
            self._hearing.pop(ident, None)
            if (not future.done() or future.cancelled()) and process is self._process:
                self._cancel(process, ident)

    async def close(self) -> None:
        """Ends the worker."""
        if self._supervisor is not None:
            self._supervisor.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._supervisor
        self._fail(GatewayError("unavailable", "the gateway is closing"))

    def _cancel(self, process: Process, ident: int) -> None:
        assert process.stdin is not None
        process.stdin.write(frames.pack(frames.Cancel(ident)))
        loop = asyncio.get_running_loop()
        self._unacknowledged[ident] = loop.call_later(STUCK_S, self._end_stuck, process)

    def _end_stuck(self, process: Process) -> None:
        self._log.error("llm_worker_stuck", pid=process.pid, seconds=STUCK_S)
        with contextlib.suppress(ProcessLookupError):
            process.kill()

    async def _supervise(self) -> None:
        """Keeps one worker alive."""
        pause = FIRST_PAUSE_S
        while True:
            self._state = "is being started"
            self._answered = False
            try:
                why = await self._run_worker()
            finally:
                self._ready, self._process = False, None
                for handle in self._unacknowledged.values():
                    handle.cancel()
                self._unacknowledged.clear()
            pause = FIRST_PAUSE_S if self._answered else min(2 * pause, LONGEST_PAUSE_S)
            self._state = f"{why}; it is started again in {pause:.1f} s"
            self._log.error("llm_worker_ended", why=why, restart_s=pause)
            self._fail(GatewayError("failed", f"the model's worker {why}"))
            self._begun()
            await asyncio.sleep(pause)

    async def _run_worker(self) -> str:
        """Runs one worker to its end; says how that came."""
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "llm_gateway.backends.llamacpp.worker"),
            *("--model", str(self._path), "--parallel", str(self._parallel)),
            *("--context", str(self._context), "--threads", str(self._threads)),
            *("--cache", str(self._cache)),
            *(("--adapter", str(self._adapter)) if self._adapter else ()),
            stdin=PIPE,
            stdout=PIPE,
            stderr=DEVNULL,
            limit=_OUTPUT_LIMIT,
        )
        self._process = process
        broken = ""
        try:
            broken = await self._listen(process)
        finally:
            await asyncio.shield(_reap(process))
        if broken:
            return f"cannot load the model: {broken}"
        code = process.returncode or 0
        name = signal.Signals(-code).name if -code in _SIGNALS else f"exit code {code}"
        return f"ended by {name}"

    async def _listen(self, process: Process) -> str:
        """Hands on what the worker says; returns why it is broken, if it says so."""
        assert process.stdout is not None
        begun = time.monotonic()
        broken = ""
        while True:
            try:
                head = await process.stdout.readexactly(4)
                body = await process.stdout.readexactly(frames.size(head))
            except asyncio.IncompleteReadError:
                return broken
            frame = frames.from_worker(body)
            if isinstance(frame, frames.Ready):
                self._ready = True
                took = round(time.monotonic() - begun, 2)
                self._log.info(
                    "llm_worker_ready", model=self.model, seconds=took, features=frame.features
                )
                self._begun()
            elif isinstance(frame, frames.Broken):
                broken = frame.why
                self._begun(SettingError(f"the embedded model: {broken}"))
            elif isinstance(frame, frames.Gone):
                if handle := self._unacknowledged.pop(frame.ident, None):
                    handle.cancel()
            elif isinstance(frame, frames.Words):
                if hear := self._hearing.get(frame.ident):
                    hear(frame.text)
            else:
                self._settle(frame)

    def _settle(self, frame: frames.Answer | frames.Failed) -> None:
        self._answered = True
        future = self._waiting.get(frame.ident)
        if future is None or future.done():
            return
        if isinstance(frame, frames.Answer):
            future.set_result(Reply(frame.text, frame.tokens, frame.finish, frame.likely))
        else:
            future.set_exception(GatewayError(frame.code, frame.why))

    def _begun(self, error: SettingError | None = None) -> None:
        """Lets `start` go on: there is nothing more to wait for."""
        if self._first is not None and not self._first.done():
            if error is None:
                self._first.set_result(None)
            else:
                self._first.set_exception(error)

    def _fail(self, error: GatewayError) -> None:
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(error)


_SIGNALS = {int(one) for one in signal.Signals}


async def _reap(process: Process) -> None:
    """Ends a worker that has not ended by itself, and leaves no zombie."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        async with asyncio.timeout(CLOSE_S):
            await process.wait()
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)
        await process.wait()
