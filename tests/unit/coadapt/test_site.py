"""The site file that `up` brings, and the names that wishes may use."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from coadapt.site import bring_site, classes_of, places_of
from deploy.spec import make_spec
from swarm.messages import Place
from swarm.site_file import read_site, write_site

ROBOTS = tuple(f"R{number}" for number in range(1, 7))


def test_up_brings_the_names_of_the_simulated_factory(tmp_path: Path) -> None:
    spec = make_spec(swarm="test", robots=ROBOTS, var_dir=str(tmp_path))
    path = bring_site(spec)
    assert path == tmp_path / "site.json"
    assert read_site(path) == places_of(None, spec)
    assert {"docks", "crossing", "aisle 1"} <= {place.name for place in read_site(path)}
    assert classes_of(spec) == ("person", "forklift")


def test_a_world_that_knows_no_places_brings_none_and_takes_a_file(tmp_path: Path) -> None:
    factory = make_spec(swarm="test", robots=ROBOTS, var_dir=str(tmp_path))
    spec = replace(factory, world="scans")
    assert bring_site(spec) is None
    assert places_of(None, spec) == ()
    yard = Place("yard", ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)))
    write_site(tmp_path / "own.json", [yard])
    assert places_of(tmp_path / "own.json", spec) == (yard,)
    assert classes_of(spec) == ()
