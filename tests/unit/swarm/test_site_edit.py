"""Places that are drawn by hand: what is kept, and what cannot be a place and why."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm.errors import SettingError
from swarm.messages import Place
from swarm.messages.obeyed import Polygon
from swarm.site_edit import drawn, removed, renamed
from swarm.site_file import SiteFile, read_site, write_site

SQUARE: Polygon = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0))
ELSEWHERE: Polygon = ((10.0, 0.0), (14.0, 0.0), (12.0, 3.0))
SITE = SiteFile((Place("docks", SQUARE), Place("aisle 1", ELSEWHERE)), {"docks": ("ramp",)})


def test_a_place_is_drawn_changed_and_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "site.json"
    site = drawn(SITE, "Tor 3", SQUARE, words=("gate three", "Einfahrt"))
    assert site.names() == ("docks", "aisle 1", "Tor 3")
    assert site.words == {"docks": ("ramp",), "Tor 3": ("gate three", "Einfahrt")}
    site = drawn(site, "Tor 3", ELSEWHERE, part=True)
    assert [place.polygon for place in site.places if place.name == "Tor 3"] == [SQUARE, ELSEWHERE]
    site = renamed(site, "Tor 3", "Tor 4", words=("Ausfahrt",))
    assert site.names() == ("docks", "aisle 1", "Tor 4")
    assert site.words == {"docks": ("ramp",), "Tor 4": ("Ausfahrt",)}
    write_site(path, site)
    assert read_site(path) == site
    assert removed(removed(site, "Tor 4"), "docks") == SiteFile((Place("aisle 1", ELSEWHERE),))


def test_a_place_may_keep_its_name_and_have_other_words() -> None:
    assert renamed(SITE, "docks", "docks", words=("Rampe",)).words == {"docks": ("Rampe",)}
    assert renamed(SITE, "docks", "Docks").names() == ("Docks", "aisle 1")


@pytest.mark.parametrize(
    ("name", "words", "named"),
    [
        ("docks", (), "'docks' already means place 'docks'"),
        ("Aisle-1", (), "'Aisle-1' already means place 'aisle 1'"),
        ("Ramp", (), "'Ramp' already means place 'docks'"),
        ("yard", ("docks",), "'docks' already means place 'docks'"),
        ("yard", ("court", "Court"), "'Court' already means place 'yard'"),
        ("r3", (), "'r3' already means robot R3"),
        ("yard", ("R3",), "'R3' already means robot R3"),
        ("6", (), "'6' is no name"),
        ("a", (), "'a' is no name"),
        ("18:30", (), "'18:30' is no name"),
    ],
)
def test_a_name_that_means_something_else_is_refused(
    name: str, words: tuple[str, ...], named: str
) -> None:
    with pytest.raises(SettingError, match=named):
        drawn(SITE, name, SQUARE, words=words, robots=("R1", "R3"))


@pytest.mark.parametrize(
    ("polygon", "named"),
    [
        (((0.0, 0.0), (4.0, 3.0), (4.0, 0.0), (0.0, 3.0)), "its edges 1 and 3 meet"),
        (((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 0.0), (0.0, 4.0)), "its edges 1 and 3 meet"),
        (((0.0, 0.0), (0.0, 0.0), (4.0, 3.0)), "has corner 1 twice, at 0, 0 m"),
        (((0.0, 0.0), (4.0, 0.0), (8.0, 0.0)), "covers 0 m2; allowed: 0.1"),
        (((0.0, 0.0), (0.2, 0.0), (0.2, 0.2)), "covers 0.02 m2"),
    ],
)
def test_a_polygon_that_bounds_no_ground_is_refused(polygon: Polygon, named: str) -> None:
    with pytest.raises(SettingError, match=f"polygon of 'yard' .*{named}"):
        drawn(SITE, "yard", polygon)


def test_a_place_that_is_not_there_is_named() -> None:
    with pytest.raises(SettingError, match="no place 'yard'; known: docks, aisle 1"):
        removed(SITE, "yard")
    with pytest.raises(SettingError, match="no place 'yard'"):
        renamed(SITE, "yard", "court")
    with pytest.raises(SettingError, match="no place 'yard'; known: none"):
        drawn(SiteFile(()), "yard", SQUARE, part=True)


def test_a_site_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "site.json"
    write_site(path, SITE)
    crowded = SiteFile(tuple(Place(f"spot {number}", SQUARE) for number in range(257)))
    with pytest.raises(SettingError, match=r"would not be valid: .*places"):
        write_site(path, crowded)
    assert read_site(path) == SITE
