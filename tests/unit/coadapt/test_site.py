"""The site file that `up` brings, and the names that wishes may use."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from coadapt.site import ASIDE, bring_site, classes_of, site_file_of, site_of
from deploy.spec import SwarmSpec, make_spec
from swarm.messages import Place
from swarm.site_edit import drawn
from swarm.site_file import SiteFile, read_site, write_site

ROBOTS = tuple(f"R{number}" for number in range(1, 7))
YARD = Place("yard", ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)))


def spec_in(folder: Path) -> SwarmSpec:
    return make_spec(swarm="test", robots=ROBOTS, var_dir=str(folder), run_dir=str(folder / "run"))


def test_up_brings_the_names_of_the_simulated_factory(tmp_path: Path) -> None:
    spec = spec_in(tmp_path)
    known = site_of(None, spec)
    assert bring_site(spec) is None
    path = site_file_of(spec)
    assert path == tmp_path / "site" / "site.json"
    assert site_of(None, spec) == read_site(path)
    assert read_site(path).places == known.places
    assert {"docks", "crossing", "aisle 1"} <= set(known.names())
    assert classes_of(spec) == ("person", "forklift")


def test_what_was_drawn_stays_while_the_floor_does(tmp_path: Path) -> None:
    spec = spec_in(tmp_path)
    bring_site(spec)
    path = site_file_of(spec)
    site = drawn(read_site(path), YARD.name, YARD.polygon, words=("court",))
    write_site(path, site)
    assert bring_site(spec) is None
    assert site_of(None, spec) == site
    assert bring_site(replace(spec, world_robots=30)) == path.with_name(ASIDE)
    assert read_site(path.with_name(ASIDE)) == site
    assert "yard" not in site_of(None, spec).names()
    # Nobody has drawn on that floor: nothing is lost with it.
    assert bring_site(spec) is None
    assert read_site(path.with_name(ASIDE)) == site


def test_a_site_file_of_ones_own_is_left_alone(tmp_path: Path) -> None:
    spec = spec_in(tmp_path)
    path = site_file_of(spec)
    path.parent.mkdir()
    write_site(path, SiteFile((YARD,)))
    assert bring_site(spec) is None
    assert site_of(None, spec) == SiteFile((YARD,))


def test_a_world_that_knows_no_places_brings_none_and_takes_a_file(tmp_path: Path) -> None:
    spec = replace(spec_in(tmp_path), world="scans")
    assert bring_site(spec) is None
    assert site_of(None, spec) == SiteFile(())
    write_site(tmp_path / "own.json", SiteFile((YARD,)))
    assert site_of(tmp_path / "own.json", spec) == SiteFile((YARD,))
    assert classes_of(spec) == ()


def test_a_swarm_that_another_machine_started_has_none_of_this_ones_files(tmp_path: Path) -> None:
    spec = replace(spec_in(tmp_path), world="scans")
    path = site_file_of(spec)
    path.parent.mkdir()
    write_site(path, SiteFile((YARD,)))
    assert site_of(None, replace(spec, run_dir="")) == SiteFile(())
