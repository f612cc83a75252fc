"""Site files: what was written is read, and what cannot be a place is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarm.errors import SettingError
from swarm.messages import Place
from swarm.site_file import MAX_BYTES, SiteFile, read_site, write_site

DOCKS = Place("docks", ((0.0, 0.0), (12.5, 0.0), (12.5, 8.0)))
RAMP = Place("Rampe Süd", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))


def test_a_site_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "site.json"
    for site in (
        SiteFile((DOCKS, RAMP, DOCKS)),
        SiteFile((DOCKS,), words={"docks": ("loading bay",)}, brought="a1b2"),
    ):
        write_site(path, site)
        assert read_site(path) == site


def test_a_site_of_places_alone_is_a_site(tmp_path: Path) -> None:
    path = tmp_path / "site.json"
    path.write_text('{"places": [{"name": "docks", "polygon": [[0, 0], [12.5, 0], [12.5, 8]]}]}')
    assert read_site(path) == SiteFile((DOCKS,))
    write_site(path, SiteFile((DOCKS,)))
    assert set(json.loads(path.read_text())) == {"places"}


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "not valid"),
        (b"[]", "not valid"),
        (b"{}", "places"),
        (b'{"places": [], "rooms": []}', "rooms"),
        (b'{"places": [{"name": "", "polygon": [[0,0],[1,0],[1,1]]}]}', "name"),
        (b'{"places": [{"name": "a\\u0007b", "polygon": [[0,0],[1,0],[1,1]]}]}', "name"),
        (b'{"places": [{"name": "a", "polygon": [[0,0],[1,0]]}]}', "polygon"),
        (b'{"places": [{"name": "a", "polygon": [[0,0],[1,0],[1]]}]}', "polygon"),
        (b'{"places": [{"name": "a", "polygon": [[0,0],[1,0],[1e9,1]]}]}', "polygon"),
        (b'{"places": [], "words": {"docks": [""]}}', "words"),
        (b"\xff\xff", "not valid"),
        (b" " * (MAX_BYTES + 1), "larger than"),
    ],
)
def test_what_is_no_site_is_refused_and_named(tmp_path: Path, content: bytes, named: str) -> None:
    path = tmp_path / "site.json"
    path.write_bytes(content)
    with pytest.raises(SettingError, match=named):
        read_site(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="no-site"):
        read_site(tmp_path / "no-site.json")
