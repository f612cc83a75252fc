"""Draws sites: their robots, places and classes."""

from __future__ import annotations

import random

from swarm.messages.intent import Site

_PLACES = (
    "docks", "dock", "crossing", "racks", "ramp", "loading bay", "packing", "charging bay", "exit",
    "entrance", "main aisle", "north gate", "south gate", "assembly line", "workshop", "office",
    "canteen", "storage", "warehouse", "inbound", "outbound", "press shop", "paint shop", "yard",
    "Rampe", "Kreuzung", "Lager", "Wareneingang", "Versand", "Werkstatt", "Ladestation", "Ausgang",
    "Montage", "Verpackung", "Kantine", "Prüfstand", "Hochregal", "Nordtor", "test bench", "stairs",
    "west wing", "cold store", "sorting", "picking area", "parking",
)  # fmt: skip
_NUMBERED = ("aisle", "gate", "dock", "hall", "bay", "line", "Gang", "Tor", "Halle", "Rampe",
             "station", "zone")  # fmt: skip
_CLASSES = ("person", "box", "pallet", "forklift", "truck", "cart", "crate", "shelf", "car")


def draw(chance: random.Random) -> Site:
    """A site of 2 to 40 robots, 2 to 8 places and 2 to 6 classes."""
    count = chance.choice((4, 6, 6, 8, 12, 20, 40))
    robots = [f"R{n}" for n in range(1, count + 1)]
    if chance.random() < 0.3:
        kept = sorted(chance.sample(range(1, 41), min(count, 12)))
        robots = [f"R{n}" for n in kept]
    places = chance.sample(_PLACES, chance.randint(1, 5))
    for head in chance.sample(_NUMBERED, chance.randint(0, 2)):
        numbers = sorted(chance.sample(range(1, 10), chance.randint(1, 2)))
        places += [f"{head} {n}" for n in numbers]
    classes = chance.sample(_CLASSES, chance.randint(2, 6))
    if "person" not in classes and chance.random() < 0.8:
        classes.insert(0, "person")
    return Site(robots=tuple(robots), places=tuple(dict.fromkeys(places)), classes=tuple(classes))
