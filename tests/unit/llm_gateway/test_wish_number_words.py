"""Numbers in words, in both languages: read right or asked back, never read in part."""

from __future__ import annotations

import random
from datetime import datetime, timedelta

import pytest

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-03-03T14:05:00+00:00")
SITE = Site(
    robots=("R1", "R2", "R3", "R5", "R20", "R25"),
    places=("docks", "aisle 5", "aisle 20"),
    classes=("person", "pallet"),
)
SMALL = {
    "en": "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen "
    "fifteen sixteen seventeen eighteen nineteen",
    "de": "null eins zwei drei vier fünf sechs sieben acht neun zehn elf zwölf dreizehn vierzehn "
    "fünfzehn sechzehn siebzehn achtzehn neunzehn",
}
TENS = {
    "en": "twenty thirty forty fifty sixty seventy eighty ninety",
    "de": "zwanzig dreißig vierzig fünfzig sechzig siebzig achtzig neunzig",
}
HUNDREDS = {
    "en": ("a hundred and ", "one hundred ", "a hundred "),
    "de": ("hundert", "einhundert", "hundertund", "ein hundert "),
}
JOINED = {"en": ("-", " "), "de": ("und", " und ", "-und-")}
MOST = 180
LENGTHS = {
    "en": ("Skip R2 for {} minutes.", "Ask only R3 for the next {} minutes please"),
    "de": ("Lasst R2 für {} Minuten weg.", "Fragt nur R3 die nächsten {} Minuten."),
}
STARTS = {"en": ("Leave R2 out in {} minutes.",), "de": ("Lasst R2 in {} Minuten weg.",)}
LINKS = {
    "en": ("Use at most {} percent of the link.", "No more than {} per cent of the bandwidth"),
    "de": ("Nutzt höchstens {} Prozent der Leitung.",),
}
QUALITIES = {
    "en": ("Quality at least {} percent.", "Keep accuracy at {} percent or better"),
    "de": ("Qualität mindestens {} Prozent.", "Haltet die Genauigkeit über {} Prozent"),
}


def understood(wish: str) -> Intent:
    return understand(wish, SITE, NOW, None)


def worded(number: int, language: str, rng: random.Random) -> str:
    """A whole number below 200 in words, in one of the ways to write it."""
    hundred = rng.choice(HUNDREDS[language]) if number >= 100 else ""
    rest = number % 100
    if hundred and not rest:
        return hundred.removesuffix("und").replace(" and", "").strip()
    small, tens = SMALL[language].split(), TENS[language].split()
    if rest < len(small):
        return hundred + small[rest]
    ones = small[rest % 10] if rest % 10 else ""
    joined = rng.choice(JOINED[language])
    if language == "de":
        ones = {"eins": "ein"}.get(ones, ones)
        return hundred + (f"{ones}{joined}" if ones else "") + tens[rest // 10 - 2]
    return hundred + tens[rest // 10 - 2] + (f"{joined}{ones}" if ones else "")


def right(intent: Intent, number: int, kind: str) -> bool:
    """Whether an intent has a number where a wish of its kind has it."""
    time = (NOW + timedelta(minutes=number)).isoformat()
    held = {
        "length": intent.until == time and intent.start is None,
        "start": intent.start == time and intent.until is None,
        "link": intent.link_share == pytest.approx(number / 100),
        "quality": intent.q_min == pytest.approx(number / 100),
    }
    return held[kind]


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize(
    ("kind", "wishes"),
    [("length", LENGTHS), ("start", STARTS), ("link", LINKS), ("quality", QUALITIES)],
)
def test_numbers_in_words_are_read_right_or_asked_back(
    language: str, kind: str, wishes: dict[str, tuple[str, ...]]
) -> None:
    rng = random.Random(f"{language} {kind}")
    read = 0
    for number in range(1, MOST + 1):
        wish = rng.choice(wishes[language]).format(worded(number, language, rng))
        intent = understood(wish)
        assert intent.unclear or right(intent, number, kind), wish
        read += not intent.unclear
    assert read >= 0.5 * MOST


def test_clock_times_in_words_are_read_right_or_asked_back() -> None:
    rng = random.Random(4)
    for _ in range(300):
        hour, minute = rng.randint(1, 12), rng.randint(1, 29)
        words = {kind: worded(minute, kind, rng) for kind in ("en", "de")}
        at = {kind: worded(hour, kind, rng) for kind in ("en", "de")}
        wish, shift = rng.choice([
            (f"Leave R2 out until {words['en']} past {at['en']}.", minute),
            (f"Leave R2 out until {words['en']} to {at['en']}.", -minute),
            (f"Leave R2 out until {at['en']} {words['en']}.", minute),
            (f"Lasst R2 bis {words['de']} nach {at['de']} weg.", minute),
            (f"Lasst R2 bis {words['de']} vor halb {at['de']} weg.", -30 - minute),
            (f"Lasst R2 bis {words['de']} nach halb {at['de']} weg.", minute - 30),
        ])  # fmt: skip
        intent = understood(wish)
        if not intent.unclear:
            assert intent.until, wish
            said = datetime.fromisoformat(intent.until)
            assert (60 * said.hour + said.minute - 60 * hour - shift) % 720 == 0, wish


@pytest.mark.parametrize(
    ("wish", "minutes"),
    [
        ("Skip R2 for two-and-a-half hours.", 150),
        ("Skip R2 for one point five hours.", 90),
        ("Skip R2 for two and a quarter hours.", 135),
        ("Skip R2 for an hour and twenty-five minutes.", 85),
        ("Lasst R2 für ein und eine halbe Stunde weg.", 90),
        ("Lasst R2 für zweieinhalb Stunden weg.", 150),
        ("Lasst R2 für fünf Viertelstunden weg.", 75),
        ("Lasst R2 für zwei Komma fünf Stunden weg.", 150),
        ("Leave R2 out until eighteen hundred hours.", 235),
    ],
)
def test_halves_and_decimals_in_words(wish: str, minutes: int) -> None:
    intent = understood(wish)
    assert (intent.until, intent.unclear) == ((NOW + timedelta(minutes=minutes)).isoformat(), ())


@pytest.mark.parametrize(
    ("wish", "share"),
    [
        ("Use at most two-thirds of the link.", 0.667),
        ("Use at most twenty-five hundredths of the link.", 0.25),
        ("Use at most zero point two five of the link.", 0.25),
        ("Nutzt höchstens fünf Achtel der Leitung.", 0.625),
        ("Nutzt höchstens zwölf Komma fünf Prozent der Leitung.", 0.125),
    ],
)
def test_fractions_in_words(wish: str, share: float) -> None:
    intent = understood(wish)
    assert (intent.link_share, intent.unclear) == (share, ())


@pytest.mark.parametrize(
    "wish",
    [
        "Skip R2 for five to ten minutes.",
        "Skip R2 for one thousand two hundred minutes.",
        "Skip R2 for a dozen minutes.",
        "Skip R2 no earlier than six.",
        "Skip R2 except between six and seven.",
        "Skip R2, but not until six.",
        "Skip R2 until the twenty-fifth.",
        "Lasst R2 für fünf, zehn Minuten weg.",
        "Lasst R2 weg, außer von sechs bis sieben.",
        "Use at most two and a half percent of the link.",
        "Use at most seventy-five of a hundred percent of the link.",
        "Skip R2 and use at most an eleventh of the link.",
        "Skip R2, quality at least seventy-five.",
        "Use at most half the link and use the whole link.",
        "Watch aisle twenty-five.",
        "Skip R twenty-two.",
    ],
)
def test_numbers_that_are_not_read_whole_are_asked_back(wish: str) -> None:
    assert understood(wish).unclear


def test_robots_and_places_may_have_numbers_in_words() -> None:
    intent = understood("Skip robots twenty-five and two, watch aisle twenty.")
    assert (intent.exclude, intent.unclear) == (("R25", "R2"), ())
    assert [focus.place for focus in intent.focus] == ["aisle 20"]
