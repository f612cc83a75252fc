"""The process that runs the model: it may crash, and the gateway goes on.

Reads frames from standard input, writes frames to standard output, and ends when its input does:
no gateway, no worker.
"""

from __future__ import annotations

import argparse
import os
import queue
import sys
import threading
from pathlib import Path
from typing import BinaryIO

from llm_gateway.backends.llamacpp import frames
from llm_gateway.backends.llamacpp.engine import Engine, Outcome
from llm_gateway.backends.llamacpp.models import find_model
from llm_gateway.backends.llamacpp.native import CHUNK, ModelError, Native
from llm_gateway.backends.llamacpp.requantise import faster_form
from llm_gateway.model import Prompt
from swarm.errors import GatewayError, SettingError
from swarm.messages import ChatMessage

NICE = 10


def main(arguments: list[str] | None = None) -> int:
    """Serves until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True, help="a .gguf file, or an installed model")
    parser.add_argument("--parallel", type=int, required=True)
    parser.add_argument("--context", type=int, required=True, help="tokens of one sequence")
    parser.add_argument("--threads", type=int, required=True, help="0: one for each core")
    parser.add_argument("--cache", type=Path, help="where a faster form of it may be kept")
    parser.add_argument("--adapter", type=Path, help="what was learned beside the model")
    parser.add_argument("--try", action="store_true", dest="once", help="answer once and end")
    args = parser.parse_args(arguments)
    # Egos and robots beside it have deadlines of milliseconds, a model has seconds.
    os.nice(NICE)
    # What a library prints must not end up between frames.
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    inbox: queue.SimpleQueue[frames.ToWorker] = queue.SimpleQueue()
    if not args.once:
        threading.Thread(target=_receive, args=(sys.stdin.buffer, inbox), daemon=True).start()
    try:
        path = find_model(args.model)
        if args.cache is not None:
            path = faster_form(path, args.cache)
        native = Native(
            path,
            sequences=args.parallel,
            context=args.context,
            threads=args.threads or len(os.sched_getaffinity(0)),
            chunk=CHUNK,
            adapter=args.adapter,
        )
        engine = Engine(native, sequences=args.parallel, context=args.context)
        _try_out(engine)
    except (ModelError, SettingError, ImportError, ValueError) as error:
        print(f"the embedded model: {error}", file=sys.stderr)
        out.write(frames.pack(frames.Broken(str(error))))
        return 1
    if args.once:
        return 0
    out.write(frames.pack(frames.Ready(native.features())))
    told: set[int] = set()
    while True:
        _serve(engine, inbox, out, told)


def _receive(stream: BinaryIO, inbox: queue.SimpleQueue[frames.ToWorker]) -> None:
    """Ends the process at once, whatever the model is doing, when nobody can ask any more."""
    try:
        while (frame := frames.read(stream)) is not None:
            inbox.put(frame)
    finally:
        os._exit(0)


def _try_out(engine: Engine) -> None:
    """A build for another processor crashes here rather than at the first question."""
    engine.submit(0, Prompt((ChatMessage(role="user", content="Hello"),), max_tokens=2))
    while engine.busy:
        engine.step()


def _serve(
    engine: Engine, inbox: queue.SimpleQueue[frames.ToWorker], out: BinaryIO, told: set[int]
) -> None:
    """Takes what has come in, waiting for it if there is nothing else to do; one step.

    `told` are the prompts whose answers are told while they come.
    """
    while not engine.busy or not inbox.empty():
        if (refused := _take(engine, inbox.get(), told)) is not None:
            out.write(frames.pack(refused))
    outcomes = engine.step()
    for ident in told:
        if words := engine.words(ident):
            out.write(frames.pack(frames.Words(ident, words)))
    for ident, outcome in outcomes:
        told.discard(ident)
        out.write(frames.pack(_told(ident, outcome)))


def _told(ident: int, outcome: Outcome) -> frames.FromWorker:
    if isinstance(outcome, GatewayError):
        return frames.Failed(ident, outcome.code, outcome.why)
    return frames.Answer(ident, outcome.text, outcome.tokens, outcome.finish, outcome.likely)


def _take(engine: Engine, frame: frames.ToWorker, told: set[int]) -> frames.FromWorker | None:
    if isinstance(frame, frames.Cancel):
        engine.cancel(frame.ident)
        told.discard(frame.ident)
        return frames.Gone(frame.ident)
    try:
        engine.submit(frame.ident, frame.prompt)
    except GatewayError as error:
        return frames.Failed(frame.ident, error.code, error.why)
    if frame.words:
        told.add(frame.ident)
    return None


if __name__ == "__main__":
    sys.exit(main())
