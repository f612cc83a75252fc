"""Places that are drawn on the console: kept in the site file, known to whoever reads it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swarm.messages import Place
from swarm.site_file import SiteFile, read_site, write_site
from tests.support.console_swarm import Speakers, Viewer, ask, console
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker

YARD = [[20.0, 5.0], [25.0, 5.0], [25.0, 9.0]]
DRAW = {"act": "draw", "name": "yard", "polygon": YARD, "words": ["court"]}
DOCKS = Place("docks", ((0.0, 0.0), (5.0, 0.0), (5.0, 5.0)))


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return tmp_path / "site" / "site.json"


@pytest.fixture
def port(shared_router: RouterProcess, swarm_name: str, site: Path) -> Iterator[int]:
    with console(shared_router.address, swarm_name, console_site=str(site)) as port:
        yield port


def floor(port: int) -> dict[str, Any]:
    answer = ask(port, "GET", "/api/floor")
    assert answer.status == 200
    found: dict[str, Any] = json.loads(answer.body)
    return found


def names(port: int) -> set[str]:
    return {place["name"] for place in floor(port)["places"]}


def test_what_is_drawn_joins_what_the_world_has_and_every_page_hears_of_it(
    port: int, site: Path
) -> None:
    assert "docks" in names(port)
    assert not site.exists()
    with Viewer(port) as viewer, Viewer(port) as other:
        viewer.next()
        answer = viewer.post("place", DRAW)
        assert answer.status == 200
        assert {"name": "yard", "polygon": YARD} in json.loads(answer.body)["places"]
        other.until(lambda: "places" in other.state, "the other page hears of it")
        assert {"docks", "yard"} <= names(port)
        assert floor(port)["words"] == {"yard": ["court"]}
        kept = read_site(site)
        assert {"docks", "yard"} <= set(kept.names())

        assert viewer.post("place", DRAW).error.startswith("'yard' already means place 'yard'")
        assert viewer.post("place", DRAW | {"part": True, "words": []}).status == 200
        assert read_site(site).names().count("yard") == 1
        assert len(read_site(site).places) == len(kept.places) + 1
        renamed = {"act": "rename", "name": "yard", "to": "Hof", "words": []}
        assert viewer.post("place", renamed).status == 200
        assert "Hof" in names(port)
        assert "yard" not in names(port)
        assert viewer.post("place", {"act": "delete", "name": "Hof"}).status == 200
        assert "Hof" not in names(port)


def test_what_cannot_be_a_place_is_refused_and_the_file_stays(
    port: int, site: Path, shared_router: RouterProcess, open_session: SessionMaker
) -> None:
    speakers = Speakers(open_session(shared_router.address))
    speakers._session.declare_alive("R3")
    with Viewer(port) as viewer:
        viewer.until(lambda: "robot/R3" in viewer.state, "the robot is known")
        assert viewer.post("place", DRAW).status == 200
        before = site.read_bytes()
        for change, status, named in (
            ({"name": "R3"}, 409, "'R3' already means robot R3"),
            ({"name": "x y"}, 409, "crosses itself"),
            ({"name": "bad\u0007name"}, 400, "name"),
            ({"name": "two", "polygon": YARD[:2]}, 400, "polygon"),
            ({"name": "two", "polygon": None}, 409, "'two' has no polygon"),
            ({"name": "two", "act": "paint"}, 400, "paint"),
            ({"name": "two", "colour": "red"}, 400, "colour"),
            ({"name": "moon", "act": "delete"}, 409, "no place 'moon'; known: "),
        ):
            polygon = [[0, 0], [4, 3], [4, 0], [0, 3]] if change["name"] == "x y" else YARD
            answer = viewer.post("place", {**DRAW, "words": [], "polygon": polygon, **change})
            assert (answer.status, named in answer.error) == (status, True), answer
        for headers, status in (
            ({"X-CoAdapt-CSRF": "guessed"}, 403),
            ({"Origin": "http://evil.example"}, 403),
            ({"Content-Type": "text/plain"}, 415),
        ):
            other = {**DRAW, "name": "other", "words": []}
            assert viewer.post("place", other, **headers).status == status
        assert site.read_bytes() == before


def test_a_file_that_another_one_writes_is_read_and_one_that_is_none_is_told(
    port: int, site: Path
) -> None:
    site.parent.mkdir()
    write_site(site, SiteFile((DOCKS,)))
    assert names(port) == {"docks"}
    site.write_text('{"places": [{"name": "docks"}]}')
    shown = floor(port)
    assert shown["places"] == []
    assert "is not valid" in shown["trouble"]
    with Viewer(port) as viewer:
        viewer.next()
        assert "is not valid" in viewer.post("place", DRAW).error
    assert site.read_text() == '{"places": [{"name": "docks"}]}'


def test_without_a_site_file_nothing_is_drawn(
    shared_router: RouterProcess, swarm_name: str
) -> None:
    with console(shared_router.address, swarm_name) as port, Viewer(port) as viewer:
        viewer.next()
        assert "COADAPT_CONSOLE_SITE" in viewer.post("place", DRAW).error
        assert floor(port)["drawable"] is False
        assert "docks" in names(port)


def test_to_draw_needs_the_token(shared_router: RouterProcess, swarm_name: str, site: Path) -> None:
    values = {"console_site": str(site), "console_token": "open-sesame"}
    with console(shared_router.address, swarm_name, **values) as port:
        here = {"Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}
        assert ask(port, "POST", "/api/place", DRAW, **here).status == 401
        # The token alone is no open page.
        bearer = {"Authorization": "Bearer open-sesame"}
        assert ask(port, "POST", "/api/place", DRAW, **here, **bearer).status == 403
    assert not site.exists()
