"""What people call the things of a site, in English and German.

A site's own names always hold; these are other words for the same, by the name's main word.
"""

from __future__ import annotations


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


CLASSES = {
    "person": "person persons people human humans folks folk worker workers pedestrian pedestrians "
    "men staff employees colleagues personen mensch menschen leute leuten arbeiter arbeitern "
    "mitarbeiter mitarbeitern kollegen fussgaenger fussgaengern passanten",
    "box": "box boxes carton cartons karton kartons kiste kisten schachtel schachteln",
    "pallet": "pallet pallets palette paletten",
    "forklift": "forklift forklifts stapler staplern gabelstapler gabelstaplern",
    "truck": "truck trucks lorry lorries lkw lkws laster lastwagen",
    "car": "car cars auto autos pkw pkws",
    "cart": "cart carts trolley trolleys karren",
    "crate": "crate crates kiste kisten",
    "shelf": "shelf shelves regal regale regalen",
    "bicycle": "bicycle bicycles bike bikes fahrrad fahrraeder fahrraedern",
    "vehicle": "vehicle vehicles fahrzeug fahrzeuge fahrzeugen",
    "robot arm": "arm arms",
    "barrel": "barrel barrels drum drums fass faesser faessern tonne tonnen",
}
"""By the class's own name."""

HEADS = {
    "aisle": "aisle gang",
    "gang": "gang aisle",
    "crossing": "crossing kreuzung intersection crossroads",
    "kreuzung": "kreuzung crossing intersection",
    "gate": "gate tor",
    "tor": "tor gate",
    "hall": "hall halle",
    "halle": "halle hall",
    "rack": "rack racks regal regale regalen",
    "racks": "racks rack regale regalen regal",
    "dock": "dock docks",
    "docks": "docks dock",
    "ramp": "ramp ramps rampe rampen",
    "rampe": "rampe rampen ramp ramps",
    "lager": "lager warehouse",
    "warehouse": "warehouse lager",
    "exit": "exit ausgang",
    "ausgang": "ausgang exit",
    "entrance": "entrance eingang",
    "eingang": "eingang entrance",
    "door": "door tuer",
    "tuer": "tuer door",
    "zone": "zone bereich",
    "bay": "bay bucht",
    "station": "station",
    "office": "office buero",
    "canteen": "canteen kantine",
    "stairs": "stairs treppe treppen",
    "lift": "lift aufzug elevator",
}
"""By one word of a place's own name."""

NETWORK = _set(
    "bandwidth bandwith bandwdith link links network net traffic channel radio airtime connection "
    "bandbreite bandbrite bandbreiten netz netzes netzwerk leitung verbindung kanal funk funkkanal "
    "uebertragung datenverkehr verkehr daten data bytes"
)
COMPUTE = _set(
    "compute cpu computing computation computations processing processor processors computer "
    "computers calculation gpu rechenleistung rechner rechnern rechenzeit rechnen prozessor "
    "prozessoren rechenaufwand rechenlast"
)
QUALITY = _set(
    "quality qualitaet quallitaet qualitaets q qmin accuracy precision genauigkeit guete "
    "mindestqualitaet minqualitaet"
)
"""What Q_min is of."""
BATTERY = _set("battery batterie akku charge charged ladung geladen akkus batteries")
"""Of which a part is told, not wished."""
POLICIES = {
    "coverage": ("coverage",),
    "rules": ("rules",),
    "static": ("static",),
    "surrogate": ("surrogate",),
    "random": ("random",),
    "llm": ("llm", "language model", "sprachmodell"),
}
POLICY_WORDS = {"policy", "strategy", "strategie", "policies", "verfahren", "regelung", "decide",
                "entscheiden", "entscheidet"}  # fmt: skip
EVERYBODY = _set("all everyone everybody every each alle alles allen anyone anybody jeder")
ROBOT_WORDS = _set("robot robots bot bots roboter robotern robots robi")
