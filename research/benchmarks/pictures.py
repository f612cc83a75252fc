"""The pictures of the console in docs/pictures, light and dark: `make pictures`.

A real swarm of six robots, seen by the browser that the tests use, and steered by the page's own
controls: its link is made narrow, one robot is taken off duty, and another one tells of itself.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from research.benchmarks import live
from research.benchmarks.browser import browser, why_not

if TYPE_CHECKING:
    from playwright.sync_api import Page

FOLDER = Path("docs/pictures")
NAMES = {"light": "console.png", "dark": "console-dark.png"}
WIDTH, HEIGHT = 1440, 1000
SETTINGS = {"COADAPT_FUSION_RATE_HZ": "1", "COADAPT_DEADLINE_S": "0.9"}
"""As README advises for two cores."""
NARROW_MBIT_S, OFF_DUTY, SHOWN = "1", "R5", "R4"
BEFORE_MS, AFTER_MS = 60_000, 40_000
"""The timeline shows two minutes."""
COLOURS = 256


def steer(page: Page) -> None:
    """What the pictures show."""
    page.wait_for_timeout(BEFORE_MS)
    page.get_by_label("rate, Mbit/s").fill(NARROW_MBIT_S)
    page.get_by_role("button", name="Shape", exact=True).click()
    page.wait_for_timeout(AFTER_MS / 2)
    page.get_by_role("combobox", name="robot", exact=True).select_option(OFF_DUTY)
    page.get_by_role("button", name="Stop robot").click()
    page.get_by_role("button", name=SHOWN, exact=True).click()
    page.wait_for_timeout(AFTER_MS / 2)


def small(png: bytes) -> bytes:
    """The picture with a palette, which drawings need no more than."""
    from PIL import Image

    packed = io.BytesIO()
    with Image.open(io.BytesIO(png)) as picture:
        reduced = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        reduced.save(packed, "PNG", optimize=True)
    return packed.getvalue()


def main() -> int:
    """Takes the pictures."""
    if (missing := why_not() or live.why_not()) is not None:
        print(f"pictures: {missing}", file=sys.stderr)
        return 1
    watched = {"console": True, "prometheus": True}
    with live.live_swarm("factory", SETTINGS, **watched) as state, browser() as opened:
        page = opened.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.on("dialog", lambda dialog: dialog.accept())
        page.goto(state.console_url)
        steer(page)
        for scheme, name in NAMES.items():
            page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
            page.wait_for_timeout(1000)
            (FOLDER / name).write_bytes(small(page.screenshot(full_page=True)))
            print(f"pictures: {FOLDER / name}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
