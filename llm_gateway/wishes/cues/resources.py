"""Words of parts that bound quality and the link, and of saving what is short."""

from __future__ import annotations

from llm_gateway.wishes.cues.common import any_of

AT_LEAST = any_of(
    r"(?:dont|never|nicht|not) (?:\w+ )?(?:less|weniger)", "no worse", "not worse",
    "nicht schlechter", "at or above", "or above", "or higher", "up from", "not dip below",
    "nicht darunter", "nicht weniger als", "or upwards", "aufwaerts", "no lower", "not lower",
    "at least", "no less than", "not less than", "minimum", "min", "minimal", "above", "or better",
    "or more", "not drop below", "not fall below", "never below", "not below", "not under",
    "never under", "never go under", "not go under", "drop below", "fall below", "go below",
    "go under", "below", "under", "floor", "better than", "mindestens", "wenigstens", "nicht unter",
    "zumindest", "ueber", "oder mehr", "oder besser", "nicht weniger", "nie unter", "unter",
    "not sink below", "not get below", "not less", "least", "mind", "nothing under",
    "nothing below",
)  # fmt: skip
AT_MOST = any_of(
    "make do", "makes do", "stay within", "keep within", "keep to", "within", "auskommen",
    "kommt mit", r"euch bleib\w*", r"bleib\w* euch", "allerhoechstens", "nicht ueber", r"deckel\w*",
    "get by on", "get by with", "no higher than", "obergrenze", "at most", "no more than",
    "not more than", "more than", "maximum", "max", "up to", "cap", "limit", "at maximum",
    "hoechstens", "maximal", "nicht mehr", "mehr als", "bis zu", r"beschraenk\w*", r"begrenz\w*",
    "ceiling", r"restrict\w*", "SHARE only", "not exceed", "exceed", "exceeding", "ueberschreiten",
    "not above", "not over", "stay below", "stay under", "keep below", "keep under", "tops",
    "hoechst",
)  # fmt: skip
FREE = any_of(
    r"(?:ich|wir|i|we|they) (?:brauch\w*|needs?)", "free", "reserve", "reserved", "frei",
    "freihalten", r"reservier\w*", "freilassen", "leave", "others", "andere", "anderen", "unused",
    "untouched", "spare", "clear",
)  # fmt: skip
"""The part is that which is kept for others."""
SAVE = any_of(
    r"(?:dial|scale|tone|turn|wind) it (?:back|down)", "rein it in",
    "breather", "den hahn", r"haushaelt\w*", "pause",
    r"halt\w* (?:\w+ ){0,3}(?:klein|gering|flach|schlank)",
    r"keep (?:\w+ ){0,3}(?:small|low|down|lean|slim|minimal|light)", "juice", "stingy",
    "as small as", r"atmen", "a lid on", "bescheiden", r"breath\w*", r"brems\w*", "diaet", "diet",
    r"durchatmen", "eco", r"einspar\w*", "eingespart", r"geiz\w*", "gespart", "im zaum", "keep off",
    "kind to", "klein wie", "gering wie", "niedrig wie", "knapp halten", "knapp zu halten",
    "kurz halten", "lid on", "light on", "luft lassen", "luft laesst", "nibble", "nice to",
    "pfleglich", "penny", "pinch", "pinching", r"restrict\w*", r"sip", r"skimp\w*", "sparmodus",
    "sinnig", "stay off", "suutje", "zuegeln", "zurueckhaltung", "on a budget", "nachsicht", "ease",
    "eases", "easing", "ease off", "ease up", "load off", "strain off", "pressure off",
    "weight off", r"(?<!dropping )(?<!drop )off the", "back off", "dial down", "dial back",
    "scale back", "cut back", "cut down", "hold back", "tone down", "turn down", "rein in",
    r"trim\w*", r"shrink\w*", r"restrain\w*", "restraint", r"modest\w*", r"moderate\w*",
    r"sparse\w*", "precious", "as little", "not so much", "not too much", "too much", "slim",
    "keep it small", "keep it low", "smaller", "fewer", "careful", "carefully", "mindful",
    r"curb\w*", r"alleviat\w*", "unload", "offload", "lean", "dont overdo", "budget",
    r"economical\w*", r"sparing\w*", r"gering\w*", "geringhalten", r"minimier\w*",
    r"einschraenk\w*", r"schraenk\w*", "zurueckfahren", "runterfahren", "herunterfahren",
    r"zurueckhalt\w*", "zurueckhaltend", "behutsam", "vorsichtig", "massvoll", "sparflamme",
    "kuerzer treten", "schonung", "nicht so viel", "nicht zu viel", "nicht soviel", "nicht zuviel",
    "so wenig", "moeglichst wenig", "ressourcenschonend", "haushaltet", "sorgsam", "kostbar",
    "runterschrauben", "zurueckschrauben", "drosseln", r"abspeck\w*", "saeubern", "klein halten",
    "kleinhalten", "minimum", "minimal", "save", "saving", "saves", "spare", "sparing",
    r"econom\w*", "thrifty", "thrift", r"conserv\w*", r"reduc\w*", "lower", "less", "little",
    "easy", "cut", r"minimi[sz]e\w*", "low", "down", "gentle", "gently", "light", "lightly",
    "frugal", "tight", "economise", "relieve", "sparingly", r"spar", "sparen", "spart", "sparsam",
    "sparsamer", "einsparen", "schone", "schonen", "schont", "schonend", "weniger", "wenig",
    "sachte", "niedrig", r"entlast\w*", "runter", r"reduzier\w*", r"verringer\w*", "geizig",
    "haushalten", "knausrig", "senke", "senken", r"drossel\w*", "throttle", "haushalte",
)  # fmt: skip
WASTE = any_of(
    "sweat", "schwitzen", "gluehen lassen", "ins schwitzen", "melt", "fry", "bog down",
    "weigh down", "short on", "short of", "running low", "tight on", "scarce",
    r"knapp(?! (?:zu )?halt\w*)", "rar", r"eng(?! (?:zu )?halt\w*)", r"hammer\w*", r"flood\w*",
    r"clog\w*", r"hog", r"hogs", r"hogging", r"saturat\w*", r"overload\w*", r"overus\w*", "max out",
    r"maxing", r"chok\w*", r"swamp\w*", r"burden\w*", r"strain\w*", r"stress\w*", r"tax\w*",
    r"congest\w*", r"exhaust\w*", r"jam\w*", "eat up", "eating up", "burn", "burning",
    r"ueberlast\w*", r"belast\w*", r"zumuell\w*", r"verstopf\w*", r"strapazier\w*", r"vollmach\w*",
    "volldroehnen", "zuballern", r"ueberfluten", r"ueberfordern", "dicht machen", "zumachen",
    r"verbrat\w*", "verheizen", r"ueberstrapazier\w*", "waste", r"wasting", r"verschwend\w*",
    r"vergeud\w*", "squander",
)  # fmt: skip
"""With a negation: save."""
STOP = any_of(
    "stop", "quit", "cease", "lay off", "enough", "schluss", "aufhoeren", "no more", "avoid",
    "less", "weniger", r"vermeid\w*",
)  # fmt: skip
"""With waste: save."""
