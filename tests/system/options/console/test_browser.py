"""The page in a real browser, with a real swarm behind it: seen, and steered by its controls."""

from __future__ import annotations

import re
import signal
import tempfile
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from research.benchmarks import browser as chromium
from tests.support.console_browser import (
    connection,
    console_page,
    expect,
    needs_browser,
    region,
    robot_row,
    spoken,
)
from tests.support.free_ports import free_port

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Dialog, Page

pytestmark = needs_browser

READY_S = 120.0
SWARM = "looked-at"
CONTROLS_BUT = """(reached) =>
  [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0']")]
    .filter((one) => one.checkVisibility() && !one.disabled)
    .filter((one) => !reached.includes(one.id || one.className))
    .map((one) => one.outerHTML)"""


@pytest.fixture(scope="module")
def swarm() -> Iterator[SwarmSpec]:
    """Four robots in network namespaces; their link carries everybody's points."""
    runtime = NetnsRuntime()
    if (reason := runtime.available()) is not None:
        pytest.skip(f"network namespaces cannot be made here: {reason}")
    with (
        tempfile.TemporaryDirectory(prefix="cb-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", directory)
        spec = make_spec(
            swarm=SWARM,
            robots=factory_robots(4),
            rings=16,
            link_bps=55_000_000,
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


def test_the_page_shows_who_takes_part_and_why(page: Page) -> None:
    expect(robot_row(page, "R1")).to_contain_text("ego")
    for robot in ("R2", "R3", "R4"):
        expect(robot_row(page, robot)).to_contain_text(re.compile("alive(yes|no: )"))
    expect(region(page, "Decision")).to_contain_text("early from R1")
    expect(region(page, "Decision")).to_contain_text("coverage (source: policy)")
    expect(page.get_by_role("img", name=re.compile("Map of the floor: 4 robots"))).to_be_visible()


def test_a_link_that_is_shaped_on_the_page_changes_the_decision(page: Page) -> None:
    decision, links = region(page, "Decision"), region(page, "Links")
    expect(decision).to_contain_text(re.compile("early from R1, R"))
    page.get_by_label("rate, Mbit/s").fill("0.15")
    page.get_by_role("button", name="Shape", exact=True).click()
    expect(links).to_contain_text("R1 down: 150 kbit/s, by console")
    # Whether boxes, few points or rare ones: where robots are by then decides that.
    narrow = re.compile(r"C\(t\)\d{1,3} kbit/s; predicted use \d{1,2} kbit/s")
    expect(decision).to_contain_text(narrow)
    page.get_by_label("rate, Mbit/s").fill("55")
    page.get_by_role("button", name="Shape", exact=True).click()
    expect(links).to_contain_text("R1 down: 55.0 Mbit/s, by console")
    expect(decision).not_to_contain_text(narrow)
    expect(decision).to_contain_text(re.compile("early from R1, R"))


def test_congestion_is_started_and_stopped_on_the_page(page: Page) -> None:
    links = region(page, "Links")
    page.get_by_label("rate, Mbit/s").fill("55")
    page.get_by_role("button", name="Shape", exact=True).click()
    page.get_by_role("button", name="Congest", exact=True).click()
    expect(links).to_contain_text("telemetry runs towards R1")
    page.get_by_role("button", name="Stop congestion").click()
    expect(links).not_to_contain_text("telemetry runs towards R1")
    expect(links).to_contain_text("R1 down: 55.0 Mbit/s, by console")


@pytest.mark.stumble(
    "what stops a robot or everything is not asked once more", command="click Stop everything"
)
def test_a_robot_that_is_stopped_on_the_page_leaves_and_comes_back(page: Page) -> None:
    steering = region(page, "Ego and robots")
    expect(page.locator("#decision-what")).to_contain_text("R3")
    page.get_by_role("combobox", name="robot", exact=True).select_option("R3")
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.get_by_role("button", name="Stop robot").click()
    expect(steering.get_by_role("status")).to_contain_text("nothing was changed")
    asked: list[str] = []

    def agree(dialog: Dialog) -> None:
        asked.append(dialog.message)
        dialog.accept()

    page.once("dialog", agree)
    page.get_by_role("button", name="Stop robot").click()
    expect(steering.get_by_role("status")).to_contain_text("R3 is off duty")
    assert "without R3" in asked[0]
    expect(robot_row(page, "R3")).to_contain_text("off duty, by consoleno: off duty")
    expect(page.locator("#decision-what")).not_to_contain_text("R3")
    events = page.get_by_role("list", name="Events, newest first")
    expect(events).to_contain_text("R3 was taken off duty by console")
    expect(events).not_to_contain_text("R3 is lost")
    page.get_by_role("button", name="Start robot").click()
    expect(steering.get_by_role("status")).to_contain_text("R3 is on duty")
    expect(robot_row(page, "R3")).to_contain_text(re.compile("alive(yes|no: not chosen)"))
    expect(events).to_contain_text("R3 is back")


def test_the_policy_is_switched_on_the_page(page: Page) -> None:
    policy = page.get_by_role("combobox", name="policy")
    expect(policy).to_have_value("coverage")
    policy.select_option("static-late")
    page.get_by_role("button", name="Apply").click()
    expect(region(page, "Decision")).to_contain_text("static-late (source: policy)")
    expect(page.locator("#decision-what")).to_contain_text("late from R1")
    policy.select_option("coverage")
    page.get_by_role("button", name="Apply").click()
    expect(region(page, "Decision")).to_contain_text("coverage (source: policy)")


def test_a_keyboard_reaches_every_control_and_each_has_a_name(page: Page) -> None:
    expect(page.get_by_role("button", name="Shape", exact=True)).to_be_enabled()
    controls = spoken(page)
    assert len(controls) > 25
    assert [role for role, name in controls if not name] == []
    # From the top of the page, a step for each control and back at the top.
    page.evaluate("document.body.focus()")
    reached = set()
    for _ in range(len(controls) + 5):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.className"))
    missed = page.evaluate(
        CONTROLS_BUT,
        # The page itself has neither id nor class: no more than a control is to have.
        sorted(reached - {""}),
    )
    assert missed == []
    page.get_by_label("rate, Mbit/s").focus()
    page.keyboard.press("ControlOrMeta+a")
    page.keyboard.type("54")
    page.keyboard.press("Enter")
    expect(region(page, "Links")).to_contain_text("R1 down: 54.0 Mbit/s, by console")


def test_an_ego_that_stops_leaves_nothing_behind_that_looks_live(page: Page) -> None:
    expect(robot_row(page, "R2")).to_contain_text(re.compile("alive(yes|no: )"))
    NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGSTOP)
    try:
        expect(page.locator("#decision-what")).to_have_text(re.compile("^Was: "))
        expect(robot_row(page, "R2")).to_contain_text(re.compile("alivewas (in|not)"))
        expect(region(page, "Events")).to_contain_text("ego R1 decides no more")
        expect(
            page.get_by_role("img", name=re.compile("who takes part is not known"))
        ).to_be_visible()
    finally:
        NetnsRuntime().kill(SWARM, "ego-R1", signal.SIGCONT)
    expect(page.locator("#decision-what")).not_to_have_text(re.compile("^Was: "))
    expect(region(page, "Events")).to_contain_text("ego R1 decides again")


def test_a_console_that_falls_silent_is_told_with_since_when(page: Page) -> None:
    expect(page.locator("#decision-what")).to_contain_text("from R1")
    NetnsRuntime().kill(SWARM, "console", signal.SIGSTOP)
    try:
        expect(connection(page)).to_have_text(re.compile(r"no connection since \d+:\d\d:\d\d"))
        alert = page.get_by_role("alert")
        expect(alert).to_contain_text("What is shown is from then")
        expect(robot_row(page, "R2")).to_contain_text("was alive")
        expect(page.locator("#decision-what")).to_have_text(re.compile("^Was: "))
        expect(page.get_by_role("button", name="Shape", exact=True)).to_be_disabled()
    finally:
        NetnsRuntime().kill(SWARM, "console", signal.SIGCONT)
    expect(connection(page)).to_have_text("live")
    expect(page.locator("#decision-what")).not_to_have_text(re.compile("^Was: "))
