"""A browser without a screen: the system's Chromium, driven by Playwright."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")


def why_not() -> str | None:
    """None where pages can be opened, else what is missing and how to get it."""
    if importlib.util.find_spec("playwright") is None:
        return "Playwright is not installed: make setup"
    if _program() is None:
        return f"no {' or '.join(PROGRAMS)} is installed: apt-get install chromium"
    return None


@contextmanager
def browser() -> Iterator[Browser]:
    """The browser, with which pages are opened until the context ends.

    No asyncio loop may run on the calling thread meanwhile. Raises RuntimeError with `why_not`.
    """
    if (missing := why_not()) is not None:
        raise RuntimeError(missing)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Playwright's own build of Chromium comes from a server that not everybody reaches.
        opened = playwright.chromium.launch(executable_path=_program())
        try:
            yield opened
        finally:
            opened.close()


def _program() -> str | None:
    return next(filter(None, map(shutil.which, PROGRAMS)), None)
