"""Places drawn by hand: a site with one more, with one named otherwise, without one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import combinations

from msgspec.structs import replace

from swarm.errors import SettingError
from swarm.messages import Place
from swarm.messages.obeyed import Corner, Polygon
from swarm.site_file import SiteFile

LEAST_M2 = 0.1
"""A smaller place is a slip of the hand."""


def drawn(
    site: SiteFile,
    name: str,
    polygon: Polygon,
    *,
    words: Sequence[str] = (),
    part: bool = False,
    robots: Collection[str] = (),
) -> SiteFile:
    """The site with a place, or with one more polygon of one that it has (`part`).

    `polygon`: corners in order, world frame, metres; `words`: what people call it besides;
    `robots`: names that no place may have. Raises SettingError that names what is not allowed.
    """
    if part:
        _find(site, name)
    else:
        _check_names(site, name, words, robots)
    _check_polygon(name, polygon)
    other = {**site.words, name: tuple(words)} if words and not part else site.words
    return replace(site, places=(*site.places, Place(name, polygon)), words=other)


def renamed(
    site: SiteFile,
    name: str,
    to: str,
    *,
    words: Sequence[str] = (),
    robots: Collection[str] = (),
) -> SiteFile:
    """The site with a place under another name, or with other `words` for it. Raises
    SettingError."""
    _find(site, name)
    rest = removed(site, name)
    _check_names(rest, to, words, robots)
    places = tuple(replace(p, name=to) if p.name == name else p for p in site.places)
    return replace(site, places=places, words=rest.words | ({to: tuple(words)} if words else {}))


def removed(site: SiteFile, name: str) -> SiteFile:
    """The site without a place, all its polygons. Raises SettingError."""
    _find(site, name)
    words = {place: other for place, other in site.words.items() if place != name}
    return replace(site, places=tuple(p for p in site.places if p.name != name), words=words)


def _find(site: SiteFile, name: str) -> None:
    if name not in site.names():
        raise SettingError(
            f"there is no place {name!r}; known: {', '.join(site.names()) or 'none'}"
        )


def _check_names(site: SiteFile, name: str, words: Sequence[str], robots: Collection[str]) -> None:
    """Whether wishes can tell the place from all else that has a name."""
    known = {_folded(robot): f"robot {robot}" for robot in robots}
    for place in site.names():
        for said in (place, *site.words.get(place, ())):
            known[_folded(said)] = f"place {place!r}"
    for said in (name, *words):
        if len(_folded(said)) < 2 or not any(sign.isalpha() for sign in said):
            raise SettingError(f"{said!r} is no name of a place; allowed: a letter and more")
        if other := known.get(_folded(said)):
            raise SettingError(f"{said!r} already means {other}; allowed: a name of its own")
        known[_folded(said)] = f"place {name!r}"


def _folded(name: str) -> str:
    """As wishes are read: "Dock-1" and "dock 1" are one name."""
    return "".join(sign for sign in name.casefold() if sign.isalnum())


def _check_polygon(name: str, polygon: Polygon) -> None:
    edges = list(_edges(polygon))
    for number, (here, there) in enumerate(edges, start=1):
        if here == there:
            raise SettingError(
                f"the polygon of {name!r} has corner {number} twice, at {here[0]:g}, {here[1]:g} m"
            )
    for (first, one), (second, two) in combinations(enumerate(edges, start=1), 2):
        if second - first in (1, len(edges) - 1):
            continue  # Neighbours meet in their corner.
        if _meet(one, two):
            raise SettingError(
                f"the polygon of {name!r} crosses itself: its edges {first} and {second} meet"
            )
    area = abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in edges)) / 2
    if area < LEAST_M2:
        raise SettingError(
            f"the polygon of {name!r} covers {area:.2g} m2; allowed: {LEAST_M2:g} and more"
        )


def _edges(polygon: Polygon) -> Iterable[tuple[Corner, Corner]]:
    return zip(polygon, (*polygon[1:], *polygon[:1]), strict=True)


def _meet(one: tuple[Corner, Corner], two: tuple[Corner, Corner]) -> bool:
    """Whether two segments have a point in common."""
    (a, b), (c, d) = one, two
    signs = [_side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)]
    if signs[0] * signs[1] < 0 and signs[2] * signs[3] < 0:
        return True
    return any(
        sign == 0 and _between(*ends)
        for sign, ends in zip(signs, ((a, b, c), (a, b, d), (c, d, a), (c, d, b)), strict=True)
    )


def _side(a: Corner, b: Corner, point: Corner) -> int:
    """On which side of the line from a to b a point lies: -1, 0 or 1."""
    turn = (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
    return (turn > 0) - (turn < 0)


def _between(a: Corner, b: Corner, point: Corner) -> bool:
    return all(min(a[i], b[i]) <= point[i] <= max(a[i], b[i]) for i in (0, 1))
