"""Where real data lies, for tests that can use it."""

from __future__ import annotations

from pathlib import Path

from research.evaluation.sample import data_roots


def data_root() -> Path | None:
    """$COADAPT_DATA, else ../shared/data beside the repository; None where neither is there."""
    return next((root for root in data_roots() if root.is_dir()), None)
