"""A place is drawn on the floor in a real browser, and a wish that names it weighs it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from llm_gateway.wishes import understand
from research.benchmarks import browser as chromium
from swarm import keyspace
from swarm.messages import EgoSteered, EgoSteering, WishAnswer, WishRequest
from swarm.site_file import read_site
from tests.support.console_browser import (
    connection,
    console_page,
    expect,
    needs_browser,
    overlaps,
    region,
)
from tests.support.console_swarm import EGO, console
from tests.support.zenoh_fixtures import Inbox, RouterProcess, SessionMaker, wait_until_served

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

pytestmark = needs_browser

CORNERS = ((0.3, 0.3), (0.6, 0.3), (0.6, 0.6))
"""Where the map is clicked, in parts of its width and height."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium.browser() as opened:
        yield opened


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return tmp_path / "site.json"


@pytest.fixture
def address(shared_router: RouterProcess, swarm_name: str, site: Path) -> Iterator[str]:
    with console(shared_router.address, swarm_name, console_site=str(site)) as port:
        yield f"http://localhost:{port}"


def click(page: Page, *parts: tuple[float, float]) -> None:
    """Clicks on the map, where nothing else of the page lies over it."""
    canvas = page.locator("#map")
    box = canvas.bounding_box()
    assert box is not None
    for across, down in parts:
        canvas.click(position={"x": across * box["width"], "y": down * box["height"]})


def places(page: Page) -> Locator:
    return region(page, "Places")


def listed(page: Page) -> Locator:
    """The places that the page knows, a line each."""
    names = places(page).get_by_role("list", name="Places of the site")
    if not names.is_visible():
        page.locator("#places-open").click()
    return names.get_by_role("listitem")


def test_a_place_is_drawn_weighed_by_a_wish_renamed_and_deleted(
    browser: Browser,
    address: str,
    site: Path,
    shared_router: RouterProcess,
    open_session: SessionMaker,
    swarm_name: str,
) -> None:
    heard: Inbox[EgoSteering] = Inbox()

    def steered(request: EgoSteering) -> EgoSteered:
        if request.act:
            heard.put(request)
        says = ("heard",) if request.act else ()
        return EgoSteered(request=0, ego=EGO, policy="a", q_min=0.7, policies=("a",), says=says)

    def understood(request: WishRequest) -> WishAnswer:
        now = datetime.fromisoformat(request.now)
        meant = understand(request.wish, request.site, now, None)
        return WishAnswer(request=request.request, understood=meant)

    session = open_session(shared_router.address)
    session.serve(keyspace.ego_steering(swarm_name, EGO), EgoSteering, steered)
    session.serve(keyspace.llm_wish(swarm_name), WishRequest, understood)
    asking = open_session(shared_router.address)
    wait_until_served(asking, keyspace.ego_steering(swarm_name, EGO))
    wait_until_served(asking, keyspace.llm_wish(swarm_name))
    with console_page(browser, address) as page, console_page(browser, address) as other:
        for one in (page, other):
            expect(connection(one)).to_have_text("live")
            expect(one.locator("#places-count")).not_to_have_text("")
        places(page).get_by_role("button", name="Draw a place").click()
        click(page, *CORNERS)
        expect(places(page).get_by_label("corners, m")).to_have_value(
            # Three pairs of metres.
            re.compile(r"^(-?[\d.]+ -?[\d.]+(, )?){3}$")
        )
        click(page, CORNERS[0])
        name = places(page).get_by_label("name", exact=True)
        expect(name).to_be_focused()
        name.fill("loading bay <b>")
        places(page).get_by_label("what people call it besides").fill("Laderampe, ramp")
        assert overlaps(page) == []
        name.press("Enter")
        expect(places(page).get_by_role("status")).to_contain_text("wishes may name loading bay")
        assert read_site(site).words == {"loading bay <b>": ("Laderampe", "ramp")}
        expect(listed(other).filter(has_text="loading bay <b> (Laderampe, ramp)")).to_have_count(1)

        # The other page's operator wishes, in a word of the first one's.
        wishes = region(other, "Wishes")
        wishes.get_by_label("in words").fill("people near the Laderampe matter most")
        wishes.get_by_role("button", name="Read").first.click()
        expect(wishes.locator("#wish-says")).to_contain_text("heard")
        asked = heard.next()
        assert asked.intent is not None
        assert [focus.place for focus in asked.intent.focus] == ["loading bay <b>"]
        (drawn,) = asked.places
        assert len(drawn.polygon) == len(CORNERS)
        assert drawn == next(p for p in read_site(site).places if p.name == drawn.name)

        listed(page).get_by_role("button", name="Change loading bay <b>").click()
        expect(name).to_have_value("loading bay <b>")
        name.fill("docks")
        name.press("Enter")
        expect(places(page).get_by_role("status")).to_contain_text("already means place 'docks'")
        name.fill("gate")
        name.press("Enter")
        expect(listed(other).filter(has_text="gate (Laderampe, ramp)")).to_have_count(1)
        page.once("dialog", lambda dialog: dialog.accept())
        listed(page).get_by_role("button", name="Delete gate").click()
        expect(places(page).get_by_role("status")).to_contain_text("gate is deleted")
        expect(listed(other).filter(has_text="Laderampe")).to_have_count(0)
        assert "gate" not in read_site(site).names()


def test_corners_can_be_typed_undone_and_given_up(
    browser: Browser, address: str, site: Path
) -> None:
    with console_page(browser, address) as page:
        expect(connection(page)).to_have_text("live")
        draw = places(page).get_by_role("button", name="Draw a place")
        draw.click()
        corners = places(page).get_by_label("corners, m")
        corners.fill("1 1, 3 1, 3 3, 1 9")
        corners.press("Tab")
        places(page).get_by_role("button", name="Undo corner").click()
        expect(corners).to_have_value("1 1, 3 1, 3 3")
        page.keyboard.press("Escape")
        expect(corners).to_be_hidden()
        expect(draw).to_be_focused()
        draw.click()
        expect(corners).to_have_value("")
        places(page).get_by_label("name", exact=True).fill("corner")
        corners.fill("1 1, 3 1, 3 3")
        corners.press("Enter")
        expect(places(page).get_by_role("status")).to_contain_text("wishes may name corner")
        (place,) = [p for p in read_site(site).places if p.name == "corner"]
        assert place.polygon == ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0))
