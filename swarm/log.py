"""Structured logs: one JSON line an event on standard error."""

from __future__ import annotations

import sys
from typing import Any

import structlog

Logger = structlog.typing.FilteringBoundLogger
LEVELS = ("debug", "info", "warning", "error")


def make_logger(process: str, *, level: str = "info", **context: Any) -> Logger:
    """A logger that adds the process name and the given context to each line.

    Events are short names in snake case; values are scalars or short lists, never arrays or
    secrets.
    """
    logger: Logger = structlog.wrap_logger(
        structlog.PrintLogger(sys.stderr),
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
