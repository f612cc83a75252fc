"""What the tests in a browser share: a page of the console that must ask nobody else for anything,
and what a screen reader is told of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest

from research.benchmarks.browser import why_not
from tests.support.paths import REPOSITORY

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

PICTURES = REPOSITORY / "build/console"
PHONE = {"width": 390, "height": 844}
OVERLAPS = """() => {
  const found = [];
  const wide = document.documentElement.scrollWidth;
  if (wide > innerWidth) found.push(`the page is ${wide} wide, its window ${innerWidth}`);
  const boxes = [...document.querySelectorAll("section")]
    .map((one) => [one, one.getBoundingClientRect()])
    .filter(([, box]) => box.width);
  boxes.forEach(([one, a], i) => boxes.slice(i + 1).forEach(([other, b]) => {
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    const words = `${one.innerText.slice(0, 20)} on ${other.innerText.slice(0, 20)}`;
    if (wide > 1 && high > 1) found.push(words);
  }));
  for (const one of document.querySelectorAll("button, h2, dd, dt, select, label")) {
    const box = one.getBoundingClientRect();
    const shown = box.width && one.checkVisibility() && !one.closest(".scroll");
    if (shown && box.right > innerWidth + 1) found.push(`cut: ${one.innerText}`);
  }
  return found;
}"""
WAIT_MS = 60_000
"""For what a swarm does in seconds, on a machine that does much else."""
_missing = why_not()
needs_browser = pytest.mark.skipif(_missing is not None, reason=str(_missing))
expect: Any = None
if _missing is None:
    from playwright.sync_api import expect

    expect.set_options(timeout=WAIT_MS)


@contextmanager
def console_page(browser: Browser, url: str, **options: Any) -> Iterator[Page]:
    """A page of its own profile; no script may fail, and nothing may be asked of others."""
    errors: list[str] = []
    asked: set[str] = set()
    context = browser.new_context(**({"viewport": {"width": 1440, "height": 1000}} | options))
    context.set_default_timeout(WAIT_MS)
    try:
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: asked.add(urlsplit(request.url).netloc))
        page.goto(url)
        yield page
        assert errors == []
        assert asked == {urlsplit(url).netloc}
    finally:
        context.close()


def picture(page: Page, name: str) -> None:
    """Keeps how the whole page looks, for people: build/console/NAME.png."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=PICTURES / f"{name}.png", full_page=True)


def overlaps(page: Page) -> list[str]:
    """Words that do not fit: sections that cover each other, a page wider than its window."""
    found: list[str] = page.evaluate(OVERLAPS)
    return found


def connection(page: Page) -> Locator:
    return page.get_by_role("banner").get_by_role("status")


def region(page: Page, name: str) -> Locator:
    """A part of the page by its heading."""
    return page.get_by_role("region", name=name, exact=True)


def robot_row(page: Page, robot: str) -> Locator:
    """The row of a robot in the table of robots."""
    header = page.get_by_role("rowheader", name=robot, exact=True)
    return (
        page.get_by_role("table", name="Robots of the swarm").get_by_role("row").filter(has=header)
    )


def spoken(page: Page) -> list[tuple[str, str]]:
    """Role and name of everything that takes the focus, as Chromium tells a screen reader."""
    session = page.context.new_cdp_session(page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    return [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if not node["ignored"]
        and node["role"]["value"] != "RootWebArea"
        and any(p["name"] == "focusable" and p["value"]["value"] for p in node["properties"])
    ]
