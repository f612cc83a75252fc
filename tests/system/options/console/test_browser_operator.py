"""What an operator looks for, on a running swarm with Prometheus: alerts, history, one robot, the
way to recordings, on a desk and on a phone."""

from __future__ import annotations

import re
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from deploy.prometheus import Prometheus
from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from research.benchmarks import browser as chromium
from tests.support.console_browser import (
    PHONE,
    connection,
    console_page,
    expect,
    needs_browser,
    overlaps,
    picture,
    region,
    robot_row,
)
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = needs_browser

READY_S = 120.0
SEEN_S = 30.0
"""How long the swarm runs before anybody opens a page."""
SWARM = "operated"
RECORDING = "20260101T000000Z.mcap"


@pytest.fixture(scope="module")
def swarm() -> Iterator[SwarmSpec]:
    """Four robots on a shaped link, watched by Prometheus for a while."""
    runtime = NetnsRuntime()
    if (reason := runtime.available()) is not None:
        pytest.skip(f"network namespaces cannot be made here: {reason}")
    with (
        tempfile.TemporaryDirectory(prefix="co-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", directory)
        spec = make_spec(
            swarm=SWARM,
            robots=factory_robots(4),
            rings=16,
            link_bps=5_000_000,
            prometheus_port=free_port(),
            console=True,
            console_port=free_port(),
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            run_dir=f"{directory}/{SWARM}",
            var_dir=f"{directory}/var",
        )
        assert runtime.up(spec)
        try:
            wait_ready(runtime, need_state(SWARM), READY_S)
            time.sleep(SEEN_S)
            yield spec
        finally:
            runtime.down(SWARM)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium.browser() as opened:
        yield opened


@pytest.fixture
def page(swarm: SwarmSpec, browser: Browser) -> Iterator[Page]:
    """An open page that shows the swarm."""
    with console_page(browser, need_state(SWARM).console_url) as page:
        expect(connection(page)).to_have_text("live")
        yield page


@pytest.mark.stumble(
    "history begins when the page is opened", command="make up, and open localhost:8080 later"
)
def test_a_page_shows_what_was_before_it_was_opened(page: Page) -> None:
    history = region(page, "History")
    expect(history).to_contain_text("from Prometheus")
    page.locator("#history-open").click()
    rows = page.locator("#history tr")
    # Bytes that were used before anybody looked are known to Prometheus alone.
    expect(rows.nth(15)).to_contain_text(re.compile("bit/s.*bit/s"))
    page.get_by_role("combobox", name="last", exact=True).select_option("900")
    expect(history).to_contain_text("from Prometheus")
    expect(
        page.get_by_role("img", name=re.compile(r"Timeline: \d+ entries in 15 min"))
    ).to_be_visible()


@pytest.mark.stumble(
    "a robot cannot be asked why it is not chosen", command="click a robot on localhost:8080"
)
def test_a_robot_that_is_clicked_tells_of_itself_and_escape_leads_back(page: Page) -> None:
    head = robot_row(page, "R2").get_by_role("button")
    head.click()
    panel = region(page, "Robot R2")
    for words in ("takes part", "sends", "a frame takes", "beacon", "link"):
        expect(panel).to_contain_text(words)
    expect(page.get_by_role("heading", name="Robot R2")).to_be_focused()
    page.keyboard.press("Escape")
    expect(panel).to_be_hidden()
    expect(head).to_be_focused()


def test_a_robot_is_found_on_the_map(page: Page) -> None:
    expect(page.get_by_role("img", name=re.compile("Map of the floor: 4 robots"))).to_be_visible()
    canvas = page.locator("#map")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    assert box is not None
    panel = page.locator("#robot")
    # Somewhere on the floor there are robots: a sweep as fine as a finger meets one.
    for y in range(20, int(box["height"]), 30):
        for x in range(20, int(box["width"]), 30):
            page.mouse.click(box["x"] + x, box["y"] + y)
        if panel.is_visible():
            break
    expect(page.locator("#robot-heading")).to_have_text(re.compile(r"Robot R[1-4]"))


@pytest.mark.stumble("alerts are not on the page", command="open localhost:8080")
def test_an_alert_that_fires_is_on_the_page_and_goes(page: Page) -> None:
    alerts = region(page, "Alerts")
    expect(alerts).to_contain_text("from Prometheus")
    server = Prometheus(need_state(SWARM).prometheus_url)
    NetnsRuntime().kill(SWARM, "robot-R4", signal.SIGSTOP)
    try:
        await_(lambda: any(a.name == "RobotLost" for a in server.alerts()), "it fires")
        expect(alerts).to_contain_text("RobotLost")
        picture(page, "desktop-alert")
    finally:
        NetnsRuntime().kill(SWARM, "robot-R4", signal.SIGCONT)
    await_(lambda: not any(a.name == "RobotLost" for a in server.alerts()), "it is over")
    expect(alerts).not_to_contain_text("RobotLost")


def test_prometheus_that_is_gone_is_said_and_the_page_goes_on(page: Page) -> None:
    alerts = region(page, "Alerts")
    expect(alerts).to_contain_text("from Prometheus")
    NetnsRuntime().kill(SWARM, "prometheus", signal.SIGSTOP)
    try:
        expect(alerts).to_contain_text("Prometheus does not answer")
        expect(connection(page)).to_have_text("live")
    finally:
        NetnsRuntime().kill(SWARM, "prometheus", signal.SIGCONT)
    expect(alerts).to_contain_text("from Prometheus")


def test_prometheus_and_recordings_are_a_click_away(page: Page, swarm: SwarmSpec) -> None:
    link = page.get_by_role("link", name="Prometheus")
    expect(link).to_have_attribute("href", f"http://127.0.0.1:{swarm.prometheus_port}/alerts")
    file = Path(swarm.var_dir) / "recordings" / RECORDING
    page.locator("#recordings-open").click()
    expect(page.locator("#recordings")).to_contain_text(f"none yet: coadapt record --swarm {SWARM}")
    page.locator("#recordings-open").click()
    file.write_bytes(b"recorded")
    page.locator("#recordings-open").click()
    with page.expect_download() as download:
        page.get_by_role("link", name=RECORDING).click()
    assert Path(download.value.path()).read_bytes() == b"recorded"


@pytest.mark.stumble(
    "what stops a robot or everything is not asked once more", command="click Stop everything"
)
def test_to_stop_everything_is_asked_once_more(page: Page) -> None:
    links = region(page, "Links")
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.get_by_role("button", name="Stop everything").click()
    expect(links).to_contain_text("nothing was changed")
    expect(links).to_contain_text("R1 down: 5.0 Mbit/s")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_desk_shows_all_without_overlaps(page: Page, scheme: str) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    robot_row(page, "R3").get_by_role("button").click()
    page.wait_for_timeout(3000)
    picture(page, f"desktop-{scheme}")
    assert overlaps(page) == []


@pytest.mark.stumble("on a phone the map hides the decision", command="open localhost:8080")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_the_decision_above_the_map(
    swarm: SwarmSpec, browser: Browser, scheme: str
) -> None:
    with console_page(
        browser, need_state(SWARM).console_url, viewport=PHONE, color_scheme=scheme
    ) as page:
        expect(connection(page)).to_have_text("live")
        expect(page.locator("#decision-what")).to_contain_text("from R1")
        page.wait_for_timeout(3000)
        picture(page, f"phone-{scheme}")
        decision, floor = page.locator("section.decision"), page.locator("section.map")
        above, below = decision.bounding_box(), floor.bounding_box()
        assert above is not None
        assert below is not None
        assert above["y"] + above["height"] <= below["y"]
        assert above["y"] < PHONE["height"]
        assert overlaps(page) == []
