"""What people call the things of a site, in English and German.

A site's own names always hold; these are other words for the same, by the name's main word.
"""

from __future__ import annotations

import re


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


HEADS = {
    "aisle": "aisle gang",
    "gang": "gang aisle",
    "crossing": "crossing kreuzung intersection crossroads junction",
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
    "baggage": "baggage bag luggage",
    "luggage": "luggage bag baggage",
    "kommissionierung": "kommissionierung kommi",
}
"""By one word of a place's own name."""
MANY = {
    "aisle": "aisles gaenge gaengen",
    "gang": "gaenge gaengen aisles",
    "gate": "gates tore toren",
    "tor": "tore toren gates",
    "hall": "halls hallen",
    "halle": "hallen halls",
    "zone": "zones zonen",
    "bay": "bays",
    "dock": "docks",
}
"""Of those by which places are numbered, if several are meant."""
WHOLES = {
    "cross aisle": ("quergang",),
    "conveyor": ("förderband", "conveyor belt", "belt"),
    "conveyors": (
        "förderbänder", "förderbändern", "förderband", "förderbandbereich", "bänder", "bändern",
        "conveyor belts", "conveyor area", "belts",
    ),
    "docks": (
        "laderampe", "laderampen", "loading bay", "loading bays", "loading dock", "loading docks",
        "rampe", "rampen", "verladerampe",
    ),
    "machines": (
        "maschinen", "maschinenbereich", "maschinenpark", "machine area", "machinery",
    ),
    "racks": ("racking", "rack area", "regalbereich"),
}  # fmt: skip
"""What people call a place as a whole, by its own name without its number."""

NETWORK = _set(
    "wireless wifi fi wlan uplink downlink lan lte mobilfunk internet ethernet backhaul throughput "
    "durchsatz datenrate datenmenge datenvolumen datenverbindung datenleitung funknetz "
    "funkverbindung funkstrecke datennetz mesh leitungen verbindungen spectrum "
    "bandwidth bandwith bandwdith link links network net traffic channel radio airtime connection "
    "bw bandbreite bandbrite bandbreiten netz netzes netzwerk leitung verbindung kanal funk "
    "funkkanal "
    "uebertragung datenverkehr verkehr daten data bytes airwave airwaves broadband "
    "breitband funkerei megabyte megabytes gigabyte gigabytes"
)
NETWORKS = re.compile(
    r"(?:funk|netz|netzwerk|link|wlan|wifi|daten|uplink|radio|mobilfunk|uebertragungs|sende)"
    r"(?:bandbreite|last|nutzung|anteil|kapazitaet|verkehr|auslastung|leitung|verbindung|"
    r"belastung|verbrauch|budget|volumen|durchsatz|quote|limit|strecke|kanal|kanaele|rate)[ns]?"
)
"""What German makes of two of these words."""
COMPUTERS = re.compile(
    r"(?:rechen|rechner|prozessor|cpu|gpu|computer)(?:leistung|zeit|aufwand|last|kapazitaet|"
    r"arbeit|bedarf|kraft|auslastung|nutzung|power|ressourcen|budget|kerne?|verbrauch)[ns]?|"
    r"(?:bord|daten|edge|haupt|leit|schrank|zentral)(?:computer|rechner|server)[ns]?"
)
ENERGY = _set("energy power electricity strom energie")
"""Beside SAVING it is that of computing."""
SAVING = _set("save saving conserve reduce less cut spare sparen spart spar weniger einsparen")
CALCULATING = _set("rechnet rechne gerechnet")
"""Beside SPARINGLY it is computing that is to be spared; "rechnet nicht mit R3" is none."""
SENDING = _set("transmit transmitting uebertragen uebertragt sendet senden funkt funken sending")
LITTLE = _set(
    "little less wenig weniger zurueckhaltend allernoetigste allernoetigsten noetigste noetigsten"
)
"""Beside SENDING they say that the network is to be spared."""
SPARINGLY = LITTLE | _set("noetig sparsam sparsamer sparflamme")
NOT = _set("nicht nich nimmer nit net ned")
"""Before "so viel" they say the same."""
GRAPHICS = _set("graphics graphic video")
COMPUTE = _set(
    "cpus gpus cores kerne chips board bordrechner grafikkarte grafikkarten rechenkapazitaet "
    "rechnerleistung recheneinheit recheneinheiten prozessorlast prozessorleistung computern "
    "crunching compute cpu computing computation computations processing processor processors "
    "computer "
    "computers calculation gpu rechenleistung rechner rechnern rechenzeit rechnen prozessor "
    "prozessoren rechenaufwand rechenlast rechnerei server servern edgebox"
)
EDGE = _set("box boxes computer computers device devices node nodes server servers")
"""Behind "edge" they are what computes."""
ROOMS = _set("cabinet cage closet hall rack racks raum room rooms schrank")
"""Behind "server" they are a place."""
QUALITY = _set(
    "quality qualitaet quallitaet qualitaets q qmin accuracy precision genauigkeit guete "
    "mindestqualitaet minqualitaet mindestguete mindestgenauigkeit guetewert qualitaetswert "
    "qualitaetsniveau qualitaetsgrenze qualitaetsschwelle guetemass guetegrenze"
)
"""What Q_min is of."""
BATTERY = _set(
    "battery batterys batterie akku charge charged ladung geladen akkus batteries soc akkustand "
    "akkuladung restladung restakku restkapazitaet ladestand ladezustand batteriestand"
)
"""Of which a part is told, not wished."""
PLAIN_POLICIES = {
    "static-early": ("static early",),
    "static-late": ("static late",),
    "static-intermediate": ("static intermediate",),
    "static-intermediate-max": ("static intermediate max",),
    "static-intermediate-sparse": ("static intermediate sparse",),
    "static-intermediate-codebook": ("static intermediate codebook",),
    "surrogate": ("surrogate", "surrogat"),
    "random": ("zufallsauswahl",),
}
"""Names that mean nothing else."""
POLICIES = {
    "coverage": ("coverage", "abdeckung"),
    "rules": ("rules", "regeln"),
    "random": ("random", "zufall"),
    "llm": ("llm", "language model", "sprachmodell"),
}
"""Names that mean a policy beside one of POLICY_WORDS."""
POLICY_WORDS = _set(
    "policy strategy strategie policies verfahren regelung decide decides deciding decision "
    "decisions entscheide entscheiden entscheidet entscheidung entscheidungen entschieden auswahl "
    "choice choose chooses choosing selects select picks picking deciding auswaehlen auswaehlt "
    "aussuchen aussucht bestimmen bestimmt waehlt waehlen wahl versuch "
    "vergleichsversuch testlauf umschaltet "
    "hand pick handle call fine ueberlass ueberlasst selection shots charge "
    "switch umschalten umstellen mode modus algorithm algorithmus"
)
PLACES = _set("area bereich gegend ort place spot stelle zone")
"""Behind an article they may mean the place that was just named."""
TAKE = _set(
    "make makes put have has set schaltet schalt geht gehts ran did does do fahre fahrt "
    "laufen use take run go let method nimm nehmt nehmen benutze benutzen fahr fahren stell "
    "stellt stellen lass lasst mach macht methode modell"
)
"""Near a policy's name they say that it decides."""
EVERYBODY = _set("all everyone everybody every each alle alles allen anyone anybody jeder")
ROBOT_WORDS = _set("robot robots bot bots roboter robotern robots robi")
