"""What the console shows, how soon, and what it costs: `console.json`.

From the moment at which an ego's decision is published to the frame in which headless Chromium
shows it, with 6 and with 100 robots: a real router, a real console and the real page, robots and
ego that only speak (`publishers`). `frames_per_s`: animation frames that the browser gave the page;
`map_frames_per_s`: how often the map was drawn anew (never more than the 30 events a second).

Ten viewers read the stream beside the page; then the same beside one that never reads.

The ego's processor time is that of a real swarm (`research.benchmarks.console_ego`).
"""

from __future__ import annotations

import argparse
import socket
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deploy.ports import LOCALHOST
from research.benchmarks import live
from research.benchmarks.browser import browser, why_not
from research.benchmarks.console_ego import ego_shares
from research.benchmarks.console_stage import MARK, Played, played, viewers
from research.benchmarks.report import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CROWDS = (6, 100)
DECISIONS = 40
GAP_MS = 200
"""Between decisions, and a share of it at random, so that no step of the console is kept."""
SETTLE_MS = 3000
VIEWERS = 10
MISSED = 0.05
"""At this share of decisions that never came, a figure would be worth nothing."""
NOTE = f"""() => {{
  window.seen = {{}};
  window.frames = window.drawn = 0;
  const reason = document.getElementById("decision-reason");
  new MutationObserver(() => {{
    const found = /^{MARK}(\\d+)$/.exec(reason.textContent);
    // What follows a frame's callbacks is run when that frame has been painted.
    if (found) requestAnimationFrame(() => setTimeout(() => {{
      seen[found[1]] ??= (performance.timeOrigin + performance.now()) / 1000;
    }}));
  }}).observe(reason, {{ childList: true }});
  const count = () => {{ window.frames += 1; requestAnimationFrame(count); }};
  requestAnimationFrame(count);
  const canvas = document.getElementById("map").getContext("2d"), clear = canvas.clearRect;
  canvas.clearRect = function (...box) {{ window.drawn += 1; clear.apply(this, box); }};
}}"""


def on_screen(stage: Played, page: Page, rng: np.random.Generator) -> dict[str, Any]:
    """One page: how soon decisions are painted, and how often it is."""
    page.goto(stage.url)
    page.evaluate(NOTE)
    page.wait_for_timeout(SETTLE_MS)
    before = page.evaluate("[frames, drawn, performance.now()]")
    cpu_s = stage.cpu_s()
    sent = decide(stage, page, rng)
    after = page.evaluate("[frames, drawn, performance.now()]")
    frames, drawn, ms = (b - a for a, b in zip(before, after, strict=True))
    late = delays_ms(sent, page.evaluate("seen"))
    return {
        "ms": late,
        "frames_per_s": round(1000 * frames / ms, 1),
        "map_frames_per_s": round(1000 * drawn / ms, 1),
        "console_cpu_share": round((stage.cpu_s() - cpu_s) / (ms / 1000), 3),
    }


def decide(stage: Played, page: Page, rng: np.random.Generator) -> dict[str, float]:
    """Publishes decisions; when each was."""
    sent = {}
    for _ in range(DECISIONS):
        cycle, at = stage.decide()
        sent[cycle] = at
        page.wait_for_timeout(GAP_MS * rng.uniform(1.0, 1.5))
    return sent


def delays_ms(sent: Mapping[str, float], seen: Mapping[str, float]) -> list[float]:
    """From published to seen. Raises SystemExit where too many were never seen."""
    found = [1000 * (seen[cycle] - at) for cycle, at in sent.items() if cycle in seen]
    if len(found) < (1 - MISSED) * len(sent):
        raise SystemExit(f"console: of {len(sent)} decisions only {len(found)} came")
    return [round(ms, 1) for ms in found]


def ten_viewers(stage: Played, page: Page, rng: np.random.Generator) -> list[float]:
    """How soon decisions reach ten viewers beside the page, all of them together."""
    with viewers(stage.port, VIEWERS) as seen:
        page.wait_for_timeout(SETTLE_MS)
        sent = decide(stage, page, rng)
        return [ms for one in seen() for ms in delays_ms(sent, one)]


def beside_slow(stage: Played, page: Page, rng: np.random.Generator) -> list[float]:
    """The same beside a viewer that asks for the stream and never reads it."""
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect((LOCALHOST, stage.port))
        slow.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        return ten_viewers(stage, page, rng)


def screen(opened: Browser) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures and samples of what is on screen."""
    rng = np.random.default_rng(1)
    figures: dict[str, Any] = {}
    samples: dict[str, Any] = {}
    for robots in CROWDS:
        with played(robots) as stage:
            page = opened.new_page(viewport={"width": 1440, "height": 1000})
            found = on_screen(stage, page, rng)
            samples[f"event_to_screen_ms_{robots}"] = ms = found.pop("ms")
            figures |= quantiles(f"event_to_screen_ms_{{}}_{robots}", ms)
            figures |= {f"{name}_{robots}": value for name, value in found.items()}
            if robots == CROWDS[0]:
                both = {"ten_viewers": ten_viewers, "ten_viewers_beside_slow": beside_slow}
                for name, measure in both.items():
                    samples[f"{name}_ms"] = ms = measure(stage, page, rng)
                    figures |= quantiles(f"{name}_ms_{{}}", ms)
            page.close()
        print(f"console: {robots} robots", file=sys.stderr)
    return figures, samples


def quantiles(name: str, values: list[float]) -> dict[str, float]:
    """p50 and p95, under a name with a place for which of them."""
    return {name.format(f"p{q}"): round(float(np.percentile(values, q)), 1) for q in (50, 95)}


def main() -> int:
    """Measures and writes console.json."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3, help="of the ego's processor time")
    args = parser.parse_args()
    if (missing := live.why_not()) is not None:
        print(f"console: {missing}", file=sys.stderr)
        return 1
    figures, samples = ego_shares(args.rounds)
    figures |= {"browser_missing": why_not()}
    if figures["browser_missing"] is None:
        with browser() as opened:
            shown, shown_samples = screen(opened)
            figures |= shown | {
                "decisions": DECISIONS,
                "viewers": VIEWERS,
                "browser": f"headless Chromium {opened.version}, 1440 x 1000, without a graphics "
                "card",
                "publishers": "robots and ego of event_to_screen and viewers only speak; the ego "
                "of ego_cpu_share is that of a real swarm of 6",
            }
        samples |= shown_samples
        print(
            f"console: a decision is on screen after {figures['event_to_screen_ms_p95_6']} ms "
            f"(p95) with 6 robots, {figures['event_to_screen_ms_p95_100']} ms with 100"
        )
    else:
        print(f"console: what is on screen is left out: {figures['browser_missing']}")
    print(f"console: {100 * figures['ego_cpu_share_added']:.1f} % of a core added to the ego")
    write_report("console", figures, samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
