"""What people call the things of a site, in English and German.

A site's own names always hold; these are other words for the same, by the name's main word.
"""

from __future__ import annotations


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


CLASSES = {
    "agv": "agv agvs fts amr amrs",
    "aircraft": "aircraft airplane airplanes aeroplane plane planes flugzeug flugzeuge flugzeugen "
    "flieger maschine maschinen",
    "airplane": "aircraft airplane airplanes plane planes flugzeug flugzeuge flugzeugen flieger",
    "ambulance": "ambulance ambulances krankenwagen rettungswagen ambulanz",
    "animal": "animal animals dog dogs cat cats bird birds tier tiere tieren hund hunde hunden",
    "arm": "arm arms roboterarm roboterarme roboterarmen",
    "bag": "bag bags tasche taschen beutel sack saecke saecken",
    "baggage": "luggage baggage gepaeck gepaeckstuecke",
    "baggage cart": "gepaeckwagen gepaeckkarren kofferwagen",
    "barrel": "barrel barrels drum drums fass faesser faessern tonne tonnen",
    "barrier": "barrier barriers schranke schranken absperrung absperrungen barriere barrieren",
    "bed": "bed beds bett betten krankenbett krankenbetten pflegebett pflegebetten",
    "bicycle": "bicycle bicycles bike bikes fahrrad fahrraeder fahrraedern",
    "bin": "bin bins tonne tonnen behaelter behaeltern muelltonne muelltonnen",
    "bird": "bird birds vogel voegel voegeln",
    "boat": "boat boats ship ships schiff schiffe schiffen boot boote booten kahn kaehne",
    "body": "karosse karossen karosserie karosserien",
    "boulder": "boulder boulders fels felsen felsbrocken brocken",
    "box": "box boxes parcel parcels package packages paket pakete paketen carton cartons "
    "karton kartons kiste kisten schachtel schachteln",
    "bulldozer": "bulldozer bulldozers dozer dozers planierraupe planierraupen raupe raupen",
    "bus": "bus buses busse bussen coach coaches",
    "cable": "cable cables kabel kabeln",
    "cage": "cage cages kaefig kaefige gitterbox gitterboxen",
    "car": "car cars auto autos pkw pkws",
    "car body": "karosse karossen karosserie karosserien rohkarosse rohkarossen",
    "cart": "cart carts trolley trolleys karren karre wagen waegen wagerl waegeli",
    "chair": "chair chairs stuhl stuehle stuehlen",
    "child": "child children kid kids kind kinder kindern kleinkinder",
    "cleaner": "cleaner cleaners reinigungskraft reinigungskraefte putzkraft putzkraefte",
    "coil": "coil coils rolle rollen blechrolle blechrollen",
    "cone": "cone cones pylone pylonen huetchen kegel",
    "container": "container containers containern",
    "conveyor": "conveyor conveyors foerderband foerderbaender band baender",
    "cow": "cow cows cattle kuh kuehe kuehen rind rinder rindern",
    "crane": "crane cranes kran krane kraene kraenen",
    "crate": "crate crates kiste kisten",
    "customer": "customer customers shopper shoppers kunde kunden kundin kundinnen kundschaft",
    "cyclist": "cyclist cyclists radfahrer radfahrern",
    "doctor": "doctor doctors arzt aerzte aerzten aerztin aerztinnen",
    "dog": "dog dogs hund hunde hunden",
    "dolly": "dolly dollies rollwagen",
    "door": "door doors tuer tueren",
    "drone": "drone drones drohne drohnen",
    "bale": "bale bales ballen",
    "keg": "keg kegs fass faesser faessern",
    "book cart": "buecherwagen buecherwaegen buecherwagerl buecherwagerln",
    "light stand": "lampenstativ lampenstative lampenstativen stativ stative stativen",
    "bogie": "bogie bogies drehgestell drehgestelle",
    "ladle": "ladle ladles pfanne pfannen",
    "piano": "piano pianos klavier klaviere fluegel",
    "tractor": "tractor tractors traktor traktoren trecker",
    "drum": "drum drums fass faesser faessern",
    "handcart": "handcart handcarts sackkarre sackkarren handwagen",
    "sweeper": "sweeper sweepers kehrmaschine kehrmaschinen",
    "dump truck": "dumper dumpers dumptruck dumptrucks muldenkipper muldenkippern kipper kippern",
    "engine": "engine engines motor motoren",
    "excavator": "excavator excavators digger diggers bagger baggern",
    "fire truck": "feuerwehrauto feuerwehrautos loeschfahrzeug loeschfahrzeuge",
    "forklift": "forklift forklifts stapler staplern gabelstapler gabelstaplern hubstapler "
    "hubstaplern staplerfahrer lifttruck",
    "fuel truck": "tankwagen tanklaster tankfahrzeug tankfahrzeuge",
    "gate": "tor tore schranke schranken",
    "gurney": "gurney gurneys stretcher stretchers trage tragen bahre bahren",
    "hand truck": "sackkarre sackkarren",
    "haul truck": "muldenkipper muldenkippern schwerlaster",
    "helicopter": "helicopter helicopters chopper choppers hubschrauber hubschraubern helikopter",
    "ladder": "ladder ladders leiter leitern",
    "lift truck": "stapler staplern gabelstapler gabelstaplern",
    "light vehicle": "pkw pkws gelaendewagen",
    "loader": "loader loaders lader ladern radlader radladern",
    "locomotive": "locomotive locomotives loco locos lok loks lokomotive lokomotiven",
    "luggage": "luggage baggage suitcase suitcases bag bags gepaeck koffer koffern gepaeckstuecke",
    "luggage cart": "gepaeckwagen gepaeckkarren kofferwagen",
    "machine": "machine machines maschine maschinen",
    "motorcycle": "motorcycle motorcycles motorbike motorbikes motorrad motorraeder",
    "nurse": "nurse nurses pfleger pflegern pflegerin pflegerinnen schwester schwestern "
    "pflegekraefte",
    "order picker": "kommissionierer kommissionierern",
    "package": "parcel parcels package packages paket pakete paketen paeckchen",
    "pallet": "pallet pallets palette paletten europalette europaletten",
    "pallet jack": "hubwagen handhubwagen ameise ameisen",
    "pallet truck": "hubwagen handhubwagen ameise ameisen",
    "parcel": "parcel parcels package packages paket pakete paketen paeckchen",
    "passenger": "passenger passengers traveller travellers traveler travelers passagier "
    "passagiere passagieren fahrgast fahrgaeste fahrgaesten reisende reisenden",
    "patient": "patient patients patienten",
    "pedestrian": "pedestrian pedestrians fussgaenger fussgaengern passanten personen leute "
    "menschen people persons",
    "person": "person persons people human humans folks folk worker workers pedestrian "
    "pedestrians men women staffers personnel staff employees colleagues personen "
    "mensch menschen leute leuten arbeiter arbeitern mitarbeiter mitarbeitern "
    "kollegen fussgaenger fussgaengern passanten leut luet blokes bloke lads lad personals "
    "belegschaft "
    "beschaeftigte beschaeftigten kolleginnen fussgaengerinnen werker werkern frau "
    "frauen mann maenner maennern",
    "puddle": "puddle puddles pfuetze pfuetzen",
    "rack": "rack racks regal regale regalen gestell gestelle gestellen",
    "railcar": "railcar railcars waggon waggons gueterwagen",
    "reach stacker": "reachstacker reachstackers greifstapler greifstaplern",
    "reach truck": "schubmaststapler schubmaststaplern",
    "reel": "reel reels rolle rollen spule spulen trommel trommeln",
    "robot": "robots roboter robotern",
    "robot arm": "arm arms roboterarm roboterarme roboterarmen greifarm greifarme",
    "rock": "rock rocks boulder boulders fels felsen felsbrocken brocken gestein steine steinen",
    "roll cage": "rollcage rollcages rollcontainer rollcontainern rollwagen gitterwagen",
    "roll container": "rollcontainer rollcontainern rollwagen",
    "scaffold": "scaffold scaffolds scaffolding geruest gerueste geruesten",
    "scissor lift": "scherenbuehne scherenbuehnen hebebuehne hebebuehnen",
    "scooter": "scooter scooters roller rollern",
    "sheep": "sheep schaf schafe schafen",
    "shelf": "shelf shelves regal regale regalen regalfach regalfaecher",
    "ship": "ship ships boat boats vessel vessels schiff schiffe boot boote",
    "shopper": "shopper shoppers customer customers kunde kunden kundschaft",
    "shopping cart": "einkaufswagen einkaufswaegen einkaufswagerl",
    "spill": "spill spills pfuetze pfuetzen lache lachen",
    "straddle carrier": "straddlecarrier portalhubwagen vancarrier",
    "stretcher": "stretcher stretchers gurney gurneys trage tragen bahre bahren",
    "stroller": "stroller strollers pram prams buggy buggies kinderwagen kinderwaegen",
    "suitcase": "suitcase suitcases koffer koffern reisekoffer",
    "table": "table tables tisch tische tischen",
    "tanker": "tanker tankers tankwagen tanklaster",
    "tire": "tire tires tyre tyres reifen",
    "tool": "tool tools werkzeug werkzeuge werkzeugen",
    "tote": "tote totes behaelter behaeltern kiste kisten",
    "tow tractor": "schlepper schleppern zugmaschine zugmaschinen",
    "trailer": "trailer trailers anhaenger anhaengern",
    "train": "train trains zug zuege zuegen",
    "tram": "tram trams strassenbahn strassenbahnen",
    "trolley": "trolley trolleys wagen waegen wagerl waegeli rollwagen",
    "truck": "truck trucks lorry lorries lkw lkws laster lastwagen lastern lastkraftwagen",
    "tug": "tug tugs tractor tractors schlepper schleppern",
    "tugger": "tugger tuggers schlepper schleppern routenzug routenzuege routenzuegen",
    "tugger train": "tuggers routenzug routenzuege routenzuegen schleppzug schleppzuege "
    "schleppzuegen",
    "van": "van vans transporter transportern lieferwagen kleinbus kleinbusse",
    "vehicle": "vehicle vehicles fahrzeug fahrzeuge fahrzeugen wagen",
    "visitor": "visitor visitors guest guests besucher besuchern gast gaeste gaesten",
    "wagon": "wagon wagons waggon waggons wagen",
    "walker": "rollator rollatoren gehhilfe gehhilfen",
    "weld gun": "schweisszange schweisszangen",
    "wheel loader": "radlader radladern",
    "wheelchair": "wheelchair wheelchairs rollstuhl rollstuehle rollstuehlen rollstuhlfahrer",
    "worker": "worker workers arbeiter arbeitern werker werkern mitarbeiter mitarbeitern",
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
    "wireless wifi fi wlan uplink downlink lan lte mobilfunk internet ethernet backhaul throughput "
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
BATTERY = _set("battery batterys batterie akku charge charged ladung geladen akkus batteries")
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
    "hand pick handle call fine ueberlass ueberlasst selection shots charge "
    "switch umschalten umstellen mode modus algorithm algorithmus"
)
TAKE = _set(
    "use take run go let method nimm nehmt nehmen benutze benutzen fahr fahren stell stellt "
    "stellen lass lasst mach macht methode modell"
)
"""Near a policy's name they say that it decides."""
EVERYBODY = _set("all everyone everybody every each alle alles allen anyone anybody jeder")
ROBOT_WORDS = _set("robot robots bot bots roboter robotern robots robi")
