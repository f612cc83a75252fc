"""What people call the things of a site, in English and German.

A site's own names always hold; these are other words for the same, by the name's main word.
"""

from __future__ import annotations


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


CLASSES = {
    "person": "person persons people human humans folks folk worker workers pedestrian pedestrians "
    "men women staffers personnel staff employees colleagues "
    "personen mensch menschen leute leuten arbeiter arbeitern "
    "mitarbeiter mitarbeitern kollegen fussgaenger fussgaengern passanten",
    "animal": "animal animals dog dogs cat cats bird birds tier tiere tieren hund hunde hunden",
    "bed": "bed beds bett betten krankenbett krankenbetten",
    "wheelchair": "wheelchair wheelchairs rollstuhl rollstuehle rollstuehlen",
    "container": "container containers containern",
    "luggage": "luggage baggage suitcase suitcases bag bags gepaeck koffer koffern gepaeckstuecke",
    "tug": "tug tugs tractor tractors schlepper schleppern",
    "van": "van vans transporter transportern",
    "bus": "bus buses busse bussen",
    "train": "train trains zug zuege zuegen",
    "motorcycle": "motorcycle motorcycles motorbike motorbikes motorrad motorraeder",
    "trailer": "trailer trailers anhaenger anhaengern",
    "machine": "machine machines maschine maschinen",
    "conveyor": "conveyor conveyors foerderband foerderbaender band baender",
    "cone": "cone cones pylone pylonen huetchen kegel",
    "ladder": "ladder ladders leiter leitern",
    "child": "child children kid kids kind kinder kindern",
    "patient": "patient patients patienten",
    "visitor": "visitor visitors guest guests besucher besuchern gast gaeste gaesten",
    "chair": "chair chairs stuhl stuehle stuehlen",
    "table": "table tables tisch tische tischen",
    "tool": "tool tools werkzeug werkzeuge werkzeugen",
    "cable": "cable cables kabel kabeln",
    "robot": "robots roboter robotern",
    "agv": "agv agvs fts amr amrs",
    "ship": "ship ships boat boats vessel vessels schiff schiffe boot boote",
    "box": "box boxes parcel parcels package packages paket pakete paketen "
    "carton cartons karton kartons kiste kisten schachtel schachteln",
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
    "wifi fi wlan uplink downlink lan lte mobilfunk internet ethernet backhaul throughput "
    "durchsatz datenrate datenmenge datenvolumen datenverbindung datenleitung funknetz "
    "funkverbindung funkstrecke datennetz mesh leitungen verbindungen spectrum "
    "bandwidth bandwith bandwdith link links network net traffic channel radio airtime connection "
    "bandbreite bandbrite bandbreiten netz netzes netzwerk leitung verbindung kanal funk funkkanal "
    "uebertragung datenverkehr verkehr daten data bytes"
)
COMPUTE = _set(
    "cpus gpus cores kerne chips board bordrechner grafikkarte grafikkarten rechenkapazitaet "
    "rechnerleistung recheneinheit recheneinheiten prozessorlast prozessorleistung computern "
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
