"""What operators of both languages say in other words, other orders and with their reasons."""

from __future__ import annotations

from datetime import datetime

import pytest

from llm_gateway.wishes import understand
from llm_gateway.wishes.names.mentions import find
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")
SITE = Site(
    robots=("R1", "R2", "R3", "R4", "R5", "R6"),
    places=("docks", "aisle 1", "aisle 2", "ramp", "Tor 4"),
    classes=("person", "box", "forklift", "wheelchair"),
)


def understood(wish: str) -> Intent:
    return understand(wish, SITE, NOW, None)


def weights(wish: str) -> dict[str, str]:
    intent = understood(wish)
    assert intent.unclear == ()
    return {**{f.place: f.weight for f in intent.focus}, **intent.classes}


def named(wish: str, site: Site) -> list[tuple[str, tuple[str, ...]]]:
    """Of what kind things are that a wish names, and which ones."""
    return [(mention.kind, mention.names) for mention in find(wish, site, NOW).mentions]


@pytest.mark.parametrize(
    "wish",
    [
        "people near the loading bay matter most",
        "people near the lodaing bays matter most",
        "Personen bei der Laderampe sind am wichtigsten",
        "people at dock 7 matter most",
    ],
)
def test_a_place_has_the_words_that_its_site_knows(wish: str) -> None:
    words = {"dock 7": ("loading bay", "Laderampe"), "moon": ("docks",)}
    site = Site(robots=("R1",), places=("dock 7", "ramp"), classes=("person",), words=words)
    intent = understand(wish, site, NOW, None)
    assert {focus.place: focus.weight for focus in intent.focus} == {"dock 7": "high"}
    assert intent.classes == {"person": "high"}
    assert intent.unclear == ()


@pytest.mark.parametrize(
    ("wish", "saved"),
    [
        ("go easy on the wifi", "bandwidth"),
        ("ease off the uplink", "bandwidth"),
        ("quit hammering the network", "bandwidth"),
        ("don't clog the link", "bandwidth"),
        ("take some load off the processors", "compute"),
        ("the uplink is choking, send less data", "bandwidth"),
        ("bitte das WLAN schonen", "bandwidth"),
        ("den Bordrechner nicht so belasten", "compute"),
        ("das Funknetz entlasten", "bandwidth"),
        ("go easy on the airwaves", "bandwidth"),
        ("die Funkerei bitte drosseln", "bandwidth"),
        ("take some load off the edge node", "compute"),
        ("den Leitrechner schonen", "compute"),
        ("rechnet bitte weniger", "compute"),
    ],
)
def test_many_words_say_save(wish: str, saved: str) -> None:
    intent = understood(wish)
    assert (intent.save, intent.unclear) == (saved, ())


@pytest.mark.parametrize(
    "wish",
    [
        "ground R2 and R3",
        "R2 and R3 are grounded",
        "R2 adn R3 can sleep",
        "park R2, R3",
        "make do without R2 and R3",
        "r two and r three are off duty",
        "robot two and robot three stay home",
        "R2 has a loose wheel and R3 a cracked lens; do without the pair of them",
        "nix mit R2 und R3",
        "R2 und R3 bitte nicht einplanen",
        "R2 und R3 sollen ausgelassen werden",
        "ich will R2 und R3 nicht dabei haben",
    ],
)
def test_many_words_leave_robots_out_and_lists_share_them(wish: str) -> None:
    intent = understood(wish)
    assert (intent.exclude, intent.only, intent.unclear) == (("R2", "R3"), None, ())


@pytest.mark.parametrize(
    ("wish", "meant"),
    [
        ("watch the docks, the ramp doesn't matter", {"docks": "high", "ramp": "low"}),
        ("mind the people, boxes I don't care about", {"person": "high", "box": "low"}),
        ("people matter, boxes don't", {"person": "high", "box": "low"}),
        ("watch the docks, the ramp and aisle 1",
         {"docks": "high", "ramp": "high", "aisle 1": "high"}),
        ("the docks, the ramp are important", dict.fromkeys(("docks", "ramp"), "high")),
        ("never mind the ramp, but the docks, that's where I want sharp eyes",
         {"ramp": "low", "docks": "high"}),
        ("aisles 1 and 2 are hot", {"aisle 1": "high", "aisle 2": "high"}),
        ("look harder at aisle two", {"aisle 2": "high"}),
        ("Rollstühle gehen vor", {"wheelchair": "high"}),
        ("forklifts! watch the damn forklifts!", {"forklift": "high"}),
        ("the ramp please, and people above all", {"ramp": "high", "person": "high"}),
    ],
)  # fmt: skip
def test_what_follows_a_name_may_be_a_clause_of_its_own(wish: str, meant: dict[str, str]) -> None:
    assert weights(wish) == meant


@pytest.mark.parametrize(
    "wish",
    [
        "take R2 where you can",
        "am liebsten R2, wenn's geht",
        "lean on R2",
        "R2 has the new sensor, so ask R2 first",
        "prefer R2 over the rest",
    ],
)
def test_many_words_prefer(wish: str) -> None:
    intent = understood(wish)
    assert (intent.prefer, intent.unclear) == (("R2",), ())


def test_a_reason_is_no_wish_and_needs_a_wish_beside_it() -> None:
    intent = understood("As the ramp was hosed down, pay attention to it until four")
    assert [(f.place, f.weight) for f in intent.focus] == [("ramp", "high")]
    assert intent.unclear == ()
    assert understood("The ramp was hosed down, leave R2 out").unclear
    assert understood("R3 was hit, use R2 first").unclear


def test_a_number_in_words_is_only_a_number_of_the_site() -> None:
    assert understood("leave r nine out").is_empty()
    assert understood("Gang achte auf Menschen").focus == ()


@pytest.mark.parametrize(
    ("robots", "wish", "meant"),
    [
        (("AMR-03", "AMR-07", "AMR-10"), "AMR oh seven and oh three", ("AMR-07", "AMR-03")),
        (("AMR-01", "AMR-10"), "AMR one oh", ("AMR-10",)),
        (("KX-2", "KX-204", "KX-205"), "KX two oh four", ("KX-204",)),
        (("FZ-04", "FZ-14"), "FZ null vier", ("FZ-04",)),
        (("W-25", "W-31"), "W fünfundzwanzig und W einunddreißig", ("W-25", "W-31")),
        (("Unit-2", "Unit-4"), "unit four's battery", ("Unit-4",)),
        (("Unit-1", "Unit-2", "Unit-5"), "units two and five", ("Unit-2", "Unit-5")),
        (("Unit-1", "Unit-2", "Unit-3"), "units one two and three", ("Unit-1", "Unit-2", "Unit-3")),
        (("Unit-1", "Unit-2", "Unit-3"), "units one to three", ("Unit-1", "Unit-2", "Unit-3")),
        (("Unit-2", "Unit-5"), "units two and five more", ("Unit-2",)),
        (("Unit-2", "AMR-05"), "units two and five", ("Unit-2",)),
        (("Posten-1", "Posten-3"), "nur die Posten eins und drei", ("Posten-1", "Posten-3")),
        (("Posten-1", "Posten-3"), "den Posten eins und drei Leute", ("Posten-1",)),
        (("Koebi", "Heidi"), "Köbis Lidar", ("Koebi",)),
        (("Bolt", "Dash"), "1) no Bolt\n2) no turns", ("Bolt",)),
        (("Mario", "Maria"), "Maria", ("Maria",)),
    ],
)
def test_robots_are_found_by_their_numbers_in_words(
    robots: tuple[str, ...], wish: str, meant: tuple[str, ...]
) -> None:
    assert named(wish, Site(robots=robots, places=(), classes=())) == [("robot", meant)]


@pytest.mark.parametrize(
    ("robots", "wish"),
    [
        (("AMR-01", "AMR-10"), "AMR one oh two"),
        (("Mario", "Maria"), "Marie"),
        (("AMR-05", "Unit-4"), "unit 5"),
        (("Unit-2", "Unit-3"), "units two to six"),
        (("R1", "R2", "R4"), "R1 to R4 and 2"),
    ],
)
def test_a_name_is_never_taken_for_another(robots: tuple[str, ...], wish: str) -> None:
    assert named(wish, Site(robots=robots, places=(), classes=())) == [("unknown", ())]


@pytest.mark.parametrize(
    ("places", "wish", "meant"),
    [
        (
            ("inbound dock", "outbound dock", "ramp"),
            "both docks",
            ("inbound dock", "outbound dock"),
        ),
        (("Werkhalle", "Halle 2", "Tor 4"), "alle Hallen", ("Werkhalle", "Halle 2")),
        (("north dock", "south dock", "west dock"), "both docks", None),
        (("cage area", "rest area"), "all areas", None),
        (("labour rest area", "gate 2"), "rest area", ("labour rest area",)),
        (("north loading dock", "south loading dock"), "loading dock", None),
        (("Rohbau 2. OG", "Rohbau 1. OG"), "Rohbau 2. OG", ("Rohbau 2. OG",)),
        (("baggage hall", "gate 2"), "bag hall", ("baggage hall",)),
        (("Kommissionierung", "Versand"), "Kommi", ("Kommissionierung",)),
        (("Tor 21", "Tor 1"), "Tor einundzwanzig", ("Tor 21",)),
    ],
)
def test_places_are_found_by_what_they_share_or_end_with(
    places: tuple[str, ...], wish: str, meant: tuple[str, ...] | None
) -> None:
    found = named(wish, Site(robots=(), places=places, classes=()))
    assert found == ([] if meant is None else [("place", meant)])


@pytest.mark.parametrize(
    ("label", "said"),
    [
        ("straddle carrier", "Van Carriers"),
        ("tank car", "Kesselwagen"),
        ("tank truck", "Tankwagen"),
        ("bicycle", "Radfahrer"),
        ("trolley", "Wägelchen"),
        ("trailer", "Hänger"),
        ("snow groomer", "Pistenraupen"),
        ("docker", "Dockers"),
        ("cart", "pushcarts"),
        ("cart", "Rollwagen"),
        ("cart", "Handwagen"),
        ("pallet", "Palettn"),
        ("milk can", "Milchkannen"),
        ("plate", "Platten"),
        ("technician", "Technikern"),
        ("lift truck", "lift trucks"),
    ],
)
def test_classes_have_the_usual_words_of_both_languages(label: str, said: str) -> None:
    site = Site(robots=(), places=(), classes=(label, "van", "forklift"))
    assert named(said, site) == [("class", (label,))]


@pytest.mark.parametrize(
    ("wish", "kinds"),
    [
        ("the server room", []),
        ("rechnet weniger mit Heidi", []),
        ("auf coverage gehen", ["policy"]),
        ("Regeln gehen vor", ["unknown"]),
        ("watch the edge boxes", ["class"]),
        ("funkt nich so viel", ["network"]),
        ("haltet euch mit dem Senden zurück", ["network"]),
        ("sendet nur das Allernötigste", ["network"]),
        ("R2 sendet nichts zurück", ["robot"]),
        ("as few megabytes as possible", ["network"]),
        ("rechnet nicht so viel herum", ["compute"]),
        ("rechnet auf Sparflamme", ["compute"]),
        ("keep the graphics card loads low", ["compute"]),
    ],
)
def test_words_for_computing_and_policies_are_told_from_others(wish: str, kinds: list[str]) -> None:
    assert [kind for kind, _ in named(wish, SITE)] == kinds


def test_first_is_no_day_behind_a_name() -> None:
    assert understood("R2 1st pls").prefer == ("R2",)
    assert understood("leave R2 out from the 1st please").prefer == ()
