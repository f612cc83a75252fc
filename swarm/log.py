"""Structured logs: one JSON line an event on standard error."""

from __future__ import annotations

import contextlib
import sys
from typing import Any, TextIO, cast

import structlog

Logger = structlog.typing.FilteringBoundLogger


class _Bearing:
    """A text stream that loses a line rather than fail: a full log disk must not stop a robot."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()


def make_logger(process: str, *, level: str = "info", **context: Any) -> Logger:
    """A logger that adds the process name and the given context to each line.

    Events are short names in snake case; values are scalars or short lists, never arrays or
    secrets. A line that cannot be written is lost.
    """
    logger: Logger = structlog.wrap_logger(
        structlog.PrintLogger(cast(TextIO, _Bearing(sys.stderr))),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True, key="time"),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        context_class=dict,
    )
    return logger.bind(process=process, **context)
