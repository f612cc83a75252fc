"""The page in a real browser, where robots and ego are played: what a swarm seldom does."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np
import pytest

from research.benchmarks import browser as chromium
from swarm import keyspace
from swarm.arrays import pack
from swarm.messages import (
    MIXED,
    Assignment,
    EgoSteered,
    EgoSteering,
    EgoWish,
    Focus,
    Intent,
    IntentTold,
    WishAnswer,
    WishRequest,
)
from tests.support.console_browser import connection, console_page, expect, needs_browser, region
from tests.support.console_swarm import EGO, Speakers, console, rows
from tests.support.free_ports import free_port
from tests.support.zenoh_fixtures import Inbox, RouterProcess, SessionMaker

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = needs_browser

NOTHING = rows(9)
VISIBLE = pack(np.full((72, 1), 12.0, np.float32))
INKS = ("--text", "--quiet", "--fault", "--good", "--used-text", "--chosen")
"""Colours of words."""
PATIENCE = 300
"""Times that something is said before it must have been seen."""
COLOURS = """() => {
  const style = getComputedStyle(document.body);
  return [style.color, style.backgroundColor]
    .map((colour) => colour.match(/[0-9.]+/g).slice(0, 3).map(Number));
}"""
INK = """(name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim()
  .match(/[0-9a-f]{2}/gi).map((hex) => parseInt(hex, 16))"""
TOLD = """() => {
  window.told = [];
  const alert = document.querySelector("[role=alert]");
  const tell = () => told.push(alert.textContent);
  new MutationObserver(tell).observe(alert, { childList: true });
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium.browser() as opened:
        yield opened


@pytest.fixture
def page(shared_router: RouterProcess, swarm_name: str, browser: Browser) -> Iterator[Page]:
    with (
        console(shared_router.address, swarm_name) as port,
        console_page(browser, f"http://localhost:{port}") as page,
    ):
        expect(connection(page)).to_have_text("live")
        yield page


@pytest.fixture
def speakers(shared_router: RouterProcess, open_session: SessionMaker) -> Speakers:
    return Speakers(open_session(shared_router.address))


def tell(page: Page, say: Callable[[], None], script: str) -> None:
    """Says it until a script on the page holds: the console may not have listened at first, and
    what is said no more is soon shown as old."""
    for _ in range(PATIENCE):
        say()
        page.wait_for_timeout(100)
        if page.evaluate(script):
            return
    pytest.fail(f"the page never shows it: {script}")


def luminance(rgb: list[float]) -> float:
    """As WCAG defines it, 0 to 1."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in np.array(rgb) / 255
    ]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def shows(what: str, where: str = "body") -> str:
    return f"document.querySelector({where!r}).innerText.includes({what!r})"


def row_shows(robot: str, words: str) -> str:
    """A script: a row of the table of robots."""
    row = f"one.cells[0].innerText === {robot!r} && one.textContent.includes({words!r})"
    return f"[...document.querySelectorAll('#robots tr')].some((one) => {row})"


def test_words_of_the_swarm_are_never_taken_for_a_page(speakers: Speakers, page: Page) -> None:
    hostile = '<img src="x" onerror="window.hit=1"><script>window.hit=1</script>'
    tell(
        page,
        lambda: speakers.decision(1, EGO, reason=hostile, policy="<b>p</b>", repairs=(hostile,)),
        shows("onerror", "#decision-reason"),
    )
    expect(page.locator("#decision-reason")).to_have_text(hostile)
    expect(region(page, "Decision")).to_contain_text("<b>p</b> (source: policy)")
    assert page.evaluate("window.hit") is None
    assert page.locator("main img, main script, main b").count() == 0


def test_a_robot_that_takes_no_part_shows_why(speakers: Speakers, page: Page) -> None:
    for robot in ("R1", "R2", "R3", "R4", "R5"):
        speakers._session.declare_alive(robot)

    def say() -> None:
        for robot, x in (("R1", 5.0), ("R2", 10.0), ("R3", 12.0), ("R4", 60.0)):
            speakers.robot(robot, x, 8.0)
        speakers.decision(1, "R1", "R2")

    tell(
        page,
        say,
        " && ".join(
            (
                row_shows("R2", "aliveyes"),
                row_shows("R3", "aliveno: not chosen"),
                row_shows("R4", "aliveno: out of range"),
                row_shows("R5", "no: silent"),
                shows("R3: not chosen; R4: out of range; R5: silent", "#decision-facts"),
            )
        ),
    )
    page.get_by_role("button", name="R3", exact=True).click()
    # 4,000 bytes in each of ten frames a second.
    why = "no: it could, but was not chosen (coverage: 2 see more). It would add 320 kbit/s"
    tell(page, say, shows(why, "#robot-facts"))
    page.get_by_role("button", name="R4", exact=True).click()
    tell(page, say, shows("no: out of range", "#robot-facts"))


def test_where_forms_are_mixed_each_robot_shows_its_own(speakers: Speakers, page: Page) -> None:
    for robot in ("R1", "R2", "R3"):
        speakers._session.declare_alive(robot)
    sent = (
        Assignment(robot="R2", algorithm="early", rate_hz=10.0),
        Assignment(robot="R3", algorithm="late", rate_hz=2.0, places_hz=5.0, objects_only=True),
    )

    def say() -> None:
        for robot, x in (("R1", 5.0), ("R2", 10.0), ("R3", 12.0)):
            speakers.robot(robot, x, 8.0)
        speakers.decision(speakers.seq, "R1", "R2", "R3", algorithm=MIXED, assignments=sent)
        speakers.detections(R2=4000, R3=400)

    tell(
        page, say, shows("R2 early 10 Hz, R3 late 2 Hz (objects; places: 5 Hz)", "#decision-facts")
    )
    page.get_by_role("button", name="R3", exact=True).click()
    # The frame was of points alone.
    tell(page, say, shows("bit/s, as late at 2 Hz (objects; places: 5 Hz)", "#robot-facts"))
    page.get_by_role("button", name="R2", exact=True).click()
    tell(page, say, shows("bit/s, as early at 10 Hz", "#robot-facts"))
    forms = "[...document.querySelectorAll('#history td')].map((one) => one.textContent)"
    tell(page, say, f"{forms}.includes('mixed: 1 early, 1 late')")


def test_only_what_was_changed_is_asked_of_the_ego_and_its_silence_is_seen(
    page: Page, shared_router: RouterProcess, open_session: SessionMaker, swarm_name: str
) -> None:
    wishes: Inbox[EgoWish] = Inbox()

    def steered(request: EgoSteering) -> EgoSteered:
        if request.wish != EgoWish():
            wishes.put(request.wish)
        return EgoSteered(request=0, ego=EGO, policy="a", q_min=0.7, policies=("a", "b"))

    ego = open_session(shared_router.address)
    ego.serve(keyspace.ego_steering(swarm_name, EGO), EgoSteering, steered)
    policy, q_min = page.locator("#ego-policy"), page.locator("#ego-q-min")
    expect(policy).to_have_value("a")
    expect(q_min).to_have_value("0.7")
    q_min.fill("0.6")
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#steer-result")).to_contain_text("R1 decides by a, Q_min 0.7")
    assert wishes.next() == EgoWish(q_min=0.6)
    policy.select_option("b")
    ego.close()
    # What is being changed stays; what is in force is not known any more.
    expect(q_min).to_have_value("")
    expect(policy).to_have_value("b")


def test_why_shows_what_the_ego_tells_of_its_decision(
    page: Page, shared_router: RouterProcess, open_session: SessionMaker, swarm_name: str
) -> None:
    told = ("Cycle 3: R1 with R2, early fusion at 10 Hz.", "R2 is in: it adds 0.1 and costs 0.01.")

    def steered(request: EgoSteering) -> EgoSteered:
        why = told if request.why else ()
        return EgoSteered(request=0, ego=EGO, policy="a", q_min=0.7, policies=("a",), why=why)

    ego = open_session(shared_router.address)
    ego.serve(keyspace.ego_steering(swarm_name, EGO), EgoSteering, steered)
    button = page.get_by_role("button", name="Why?")
    expect(button).to_be_enabled()
    button.click()
    expect(page.locator("#why-told li")).to_have_text(list(told))
    button.click()
    expect(page.locator("#why-told")).to_be_hidden()


def test_a_wish_is_read_back_confirmed_shown_and_ended(
    page: Page,
    shared_router: RouterProcess,
    open_session: SessionMaker,
    swarm_name: str,
    speakers: Speakers,
) -> None:
    heard: Inbox[EgoSteering] = Inbox()
    meant = Intent(exclude=("R3",), focus=(Focus("docks"),), unclear=("soonish",))

    def steered(request: EgoSteering) -> EgoSteered:
        if request.act:
            heard.put(request)
        return EgoSteered(
            request=0,
            ego=EGO,
            policy="a",
            q_min=0.7,
            policies=("a",),
            number=4,
            says=("leave R3 out; docks counts more", "2.0 -> 1.0 participants"),
        )

    session = open_session(shared_router.address)
    session.serve(keyspace.ego_steering(swarm_name, EGO), EgoSteering, steered)
    expect(page.locator("#ego-policy")).to_have_value("a")
    wishes = region(page, "Wishes")
    wishes.get_by_label("in words").fill("leave R3 alone <b>and</b> watch the docks, soonish")
    read = wishes.get_by_role("button", name="Read").first
    # Nobody understands words here yet: the fields say the same.
    read.click()
    expect(wishes.get_by_role("status")).to_contain_text("the fields below say the same")
    expect(wishes.get_by_label("leave out")).to_be_visible()
    asked: Inbox[WishRequest] = Inbox()

    def understood(request: WishRequest) -> WishAnswer:
        asked.put(request)
        return WishAnswer(request=request.request, understood=meant)

    session.serve(keyspace.llm_wish(swarm_name), WishRequest, understood)
    said = wishes.locator("#wish-says")
    for _ in range(PATIENCE):  # Until the router knows who answers now.
        read.click()
        expect(wishes.get_by_role("status")).not_to_contain_text("asking")
        if said.get_by_role("listitem").count():
            break
    expect(said).to_contain_text("leave R3 out; docks counts more")
    expect(said).to_contain_text("not clear: “soonish”")
    assert "docks" in asked.next().site.places
    wishes.get_by_role("button", name="Obey it").click()
    expect(wishes.get_by_role("status")).to_contain_text("R1 obeys wish 4")
    tried, confirmed = heard.next(), heard.next()
    assert (tried.act, confirmed.act) == ("try", "confirm")
    assert confirmed.intent == meant
    assert {place.name for place in confirmed.places} == {"docks"}
    assert confirmed.operator == "console"

    told = IntentTold(
        number=4,
        operator="ann",
        since_ns=0,
        until=None,
        says="leave <i>R3</i> out",
        bound=("R3 left out",),
    )
    row = wishes.get_by_role("list", name="Wishes in force").get_by_role("listitem")
    for cycle in range(PATIENCE):
        speakers.decision(7 + cycle, EGO, intents=(told,))
        page.wait_for_timeout(50)
        if row.count():
            break
    expect(row).to_contain_text("leave <i>R3</i> out (R3 left out)")
    row.get_by_role("button", name="End wish 4").click()
    expect(wishes.get_by_role("status")).to_contain_text("wish 4 has ended")
    assert heard.next().act == "withdraw"


def test_robots_far_apart_are_shown_where_no_floor_plan_bounds_them(
    shared_router: RouterProcess, swarm_name: str, browser: Browser, speakers: Speakers
) -> None:
    for robot in ("R1", "R2"):
        speakers._session.declare_alive(robot)

    def say() -> None:
        for robot, x in (("R1", 0.0), ("R2", 1e6)):
            speakers.robot(robot, x, x)
            speakers.scene(robot, x, x, VISIBLE, NOTHING)

    with (
        console(shared_router.address, swarm_name, world="opv2v") as port,
        console_page(browser, f"http://localhost:{port}") as page,
    ):
        tell(page, say, row_shows("R2", "1000000.0"))
        expect(page.get_by_role("img", name="Map of the floor: 2 robots")).to_be_visible()


@pytest.mark.stumble("the map shows boxes below the operating point", command="open localhost:8080")
def test_boxes_are_drawn_from_the_operating_point_on_and_a_slider_shows_more(
    speakers: Speakers, page: Page
) -> None:
    boxes = [(10.0 * i, 8.0, 0.5, 1.0, 1.0, 1.0, 0.0) for i in range(3)]
    scores = (0.9, 0.55, 0.3)

    def say(operating_point: float | None) -> Callable[[], None]:
        def told() -> None:
            speakers.robot(EGO, 5.0, 8.0)
            speakers.detections(*boxes, scores=scores, operating_point=operating_point)

        return told

    speakers._session.declare_alive(EGO)
    # Raw scores of a detector that nobody has calibrated only rank boxes.
    tell(page, say(None), shows("0.50 (not calibrated), 2 of 3 boxes", "#box-words"))
    tell(page, say(0.25), shows("0.25 (operating point), 3 of 3 boxes", "#box-words"))
    slider = page.get_by_role("slider", name="boxes from score")
    slider.fill("0.6")
    tell(page, say(0.25), shows("0.60 (chosen here), 1 of 3 boxes", "#box-words"))
    page.get_by_role("button", name="Back to the operating point").click()
    tell(page, say(0.25), shows("0.25 (operating point), 3 of 3 boxes", "#box-words"))


def test_without_prometheus_the_page_tells_of_what_it_sees_itself(
    speakers: Speakers, page: Page
) -> None:
    alerts = region(page, "Alerts")
    expect(alerts).to_contain_text("none")
    expect(alerts).to_contain_text("the swarm runs without Prometheus")
    expect(page.locator("#timeline-from")).to_contain_text("the swarm runs without Prometheus")
    expect(page.get_by_role("link", name="Prometheus")).to_be_hidden()

    def say() -> None:
        speakers.decision(speakers.seq, EGO)
        speakers.demand(reachable=False)

    tell(page, say, shows("Q_min 0.7 is out of reach: C(t) is too small", "#alerts"))
    expect(page.locator("#alerts-count")).to_have_text("1 now")


def test_an_empty_floor_is_shown_as_such(page: Page) -> None:
    expect(page.locator("#robots-count")).to_have_text("0 alive")
    expect(page.get_by_role("img", name="Map of the floor: 0 robots, 0 take part")).to_be_visible()
    expect(page.locator("#decision-what")).to_have_text("none yet")
    expect(page.get_by_role("img", name=re.compile("Timeline: no decision"))).to_be_visible()


def test_a_hundred_robots_are_all_in_the_table(speakers: Speakers, page: Page) -> None:
    ids = [f"R{i + 1}" for i in range(100)]
    for robot in ids:
        speakers._session.declare_alive(robot)

    def say() -> None:
        for i, robot in enumerate(ids):
            speakers.robot(robot, 4.0 * (i % 10), 4.0 * (i // 10))
            speakers.scene(robot, 4.0 * (i % 10), 4.0 * (i // 10), VISIBLE, NOTHING)
        speakers.decision(1, *ids)

    tell(page, say, shows("and 88 more", "#decision-what"))
    expect(page.locator("#robots-count")).to_have_text("100 alive")
    first = page.locator("#robots tr th")
    assert first.all_inner_texts() == ids


def test_light_and_dark_follow_the_system_and_both_can_be_read(page: Page) -> None:
    contrasts = {}
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        text, ground = map(luminance, page.evaluate(COLOURS))
        contrasts[scheme] = (max(text, ground) + 0.05) / (min(text, ground) + 0.05)
        assert (ground > text) == (scheme == "light")
        panel = luminance(page.evaluate(INK, "--panel"))
        for name in INKS:
            ink = luminance(page.evaluate(INK, name))
            # WCAG's contrast for words.
            assert (max(ink, panel) + 0.05) / (min(ink, panel) + 0.05) > 4.5, (scheme, name)
    # WCAG's enhanced contrast.
    assert min(contrasts.values()) > 7


def test_a_machine_that_has_slept_asks_anew_rather_than_trust_its_clock(page: Page) -> None:
    page.evaluate(TOLD)
    with page.expect_request("**/api/events"):
        page.evaluate("{ const now = Date.now; Date.now = () => now() + 3600000; }")
    expect(connection(page)).to_have_text("live")
    assert "this machine slept" in page.evaluate("told.join()")


@pytest.mark.stumble(
    "a browser that loses the stream", command="open localhost:8080, make down, up"
)
def test_a_console_that_comes_again_is_found_without_a_reload(
    shared_router: RouterProcess, swarm_name: str, browser: Browser
) -> None:
    port = free_port()
    with ExitStack() as stack:
        with console(shared_router.address, swarm_name, console_port=port):
            page = stack.enter_context(console_page(browser, f"http://localhost:{port}"))
            expect(connection(page)).to_have_text("live")
            rate = page.get_by_label("rate, Mbit/s")
            expect(rate).to_be_enabled()
            rate.focus()
        expect(connection(page)).to_have_text(re.compile(r"no connection since \d+:\d\d:\d\d"))
        expect(rate).to_be_disabled()
        stack.enter_context(console(shared_router.address, swarm_name, console_port=port))
        expect(connection(page)).to_have_text("live")
        expect(page.get_by_role("alert")).to_be_hidden()
        expect(rate).to_be_focused()
        # The pages are closed before the console is.
        page.close()


def test_a_token_is_asked_for_and_a_wrong_one_opens_nothing(
    shared_router: RouterProcess, swarm_name: str, browser: Browser
) -> None:
    with (
        console(shared_router.address, swarm_name, console_token="open-sesame") as port,
        console_page(browser, f"http://localhost:{port}") as page,
    ):
        page.get_by_label("Token").fill("wrong")
        page.get_by_role("button", name="Open").click()
        # Another page, which asks again.
        expect(page.get_by_label("Token")).to_have_value("")
        page.get_by_label("Token").fill("open-sesame")
        page.get_by_role("button", name="Open").click()
        expect(connection(page)).to_have_text("live")
