"""Spreads pieces of work over processes."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import TypeVar

from swarm.errors import EvaluationError
from swarm.memory import keep_freed_memory

P = TypeVar("P")
R = TypeVar("R")


def each(
    work: Callable[[P], R], pieces: Sequence[P], workers: int, detector: str
) -> Iterator[tuple[int, R]]:
    """The place of every piece and its result, as they are ready.

    `work` must be importable. All algorithms of a process share the maps of the named detector.
    Raises EvaluationError when a process ends before its work is done.
    """
    # Forking a process in which PyTorch has run is not safe.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _prepare, (detector,)) as pool:
        places = {pool.submit(work, piece): at for at, piece in enumerate(pieces)}
        try:
            for done in as_completed(places):
                yield places[done], done.result()
        except BrokenProcessPool as error:
            raise EvaluationError(
                "a process ended before its work was done (out of memory?); what is finished is "
                "kept: run it again, with fewer --workers"
            ) from error
        except BaseException:
            # Whoever stops does not wait for what is still at work.
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _prepare(detector: str) -> None:
    """One thread a process: there are as many processes as cores."""
    import torch

    from research.evaluation.sharing import share_maps

    keep_freed_memory()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    share_maps(detector)


def _end_with_parent() -> None:
    """A worker whose parent was killed would otherwise finish all that is queued."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
