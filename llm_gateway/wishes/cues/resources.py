"""Words of parts that bound quality and the link, and of saving what is short."""

from __future__ import annotations

from llm_gateway.wishes.cues.common import any_of

AT_LEAST = any_of(
    "above", "at least", "at or above", "aufwaerts", "below", "better than",
    r"(?:dont|never|nicht|not) (?:\w+ )?(?:less|weniger)", "drop below", "fall below", "floor",
    "go below", "go under", "least", "min", "mind", "mindestens", "minimal", "minimum",
    "never below", "never go under", "never under", "nicht darunter", "nicht schlechter",
    "nicht unter", "nicht weniger", "nicht weniger als", "nie unter", "no less than", "no lower",
    "no worse", "not below", "not dip below", "not drop below", "not fall below", "not get below",
    "not go under", "not less", "not less than", "not lower", "not sink below", "not under",
    "not worse", "nothing below", "nothing under", "oder besser", "oder mehr", "or above",
    "or better", "or higher", "or more", "or upwards", "ueber", "under", "unter", "up from",
    "wenigstens", "zumindest",
)  # fmt: skip
AT_MOST = any_of(
    "allerhoechstens", "at maximum", "at most", "auskommen", r"begrenz\w*", r"beschraenk\w*",
    "bis zu", r"bleib\w* euch", "cap", "ceiling", r"deckel\w*", r"euch bleib\w*", "exceed",
    "exceeding", "get by on", "get by with", "hoechst", "hoechstens", "keep below", "keep to",
    "keep under", "keep within", "kommt mit", "limit", "make do", "makes do", "max", "maximal",
    "maximum", "mehr als", "more than", "nicht mehr", "nicht ueber", "no higher than",
    "no more than", "not above", "not exceed", "not more than", "not over", "obergrenze",
    "(?:can|may) (?:have|take|use) SHARE", "(?:darfst|duerft|kannst|koennt) SHARE", "SHARE only",
    r"restrict\w*", "stay below", "stay under", "stay within", "tops",
    "ueberschreiten", "up to", "within",
)  # fmt: skip
FREE = any_of(
    r"(?:held|hold|keep|kept) (?:[a-z]+ ){0,3}SHARE (?:[a-z]+ |NET )*(?:available|back|open)",
    "hands off", "hold back", "keep back", "(?:keep|stay) (?:away from|off)", "mitts off",
    "nicht (?:anruehren|antasten)", "(?:are|is) not (?:for you|yours)",
    "(?:ist|sind) nicht fuer euch", r"SHARE (?:\w+ )*duerft ihr nicht", "SHARE luft",
    r"gebt SHARE .*ab", "give up SHARE", r"verzicht\w* auf SHARE", r"zurueckhalt\w*",
    r"(?:make sure|should be|want) .*left",
    "andere", "anderen", "clear", "free", "frei", "freihalten", "freilassen",
    r"(?:ich|wir|i|we|they) (?:brauch\w*|needs?)", "leave", "others", "reserve", "reserved",
    r"reservier\w*", "spare", "uebrig", "uebriglassen", "untouched", "unused",
)  # fmt: skip
"""The part is that which is kept for others."""
SAVE = any_of(
    "a lid on", r"abspeck\w*", r"alleviat\w*", "as little", "as small as", "atmen", "back off",
    "behutsam", "bescheiden", r"breath\w*", "breather", r"brems\w*", "budget", "careful",
    "carefully", r"conserv\w*", r"curb\w*", "cut", "cut back", "cut down", "den hahn", "diaet",
    "dial back", "dial down", "(?:dial|scale|tone|turn|wind) it (?:back|down)", "diet",
    "dont overdo", r"down(?! (?:below|here|there|under)\b| (?:at|by|in|on)(?: the)? PLACE\b)",
    "(?<!dropping )(?<!drop )off the", r"drossel\w*", "drosseln", "durchatmen", "ease", "ease off",
    "ease up", "eases", "easing", "easy", "eco", r"econom\w*", r"economical\w*", "economise",
    "eingespart", r"einschraenk\w*", r"einspar\w*", "einsparen", r"entlast\w*", "fewer", "frugal",
    r"geiz\w*", "geizig", "gentle", "gently", r"gering\w*", "gering wie", "geringhalten", "gespart",
    r"halt\w* (?:\w+ ){0,3}(?:klein|gering|flach|schlank)", r"haushaelt\w*", "haushalte",
    "haushalten", "haushaltet", "herunterfahren", "hold back", "im zaum", "juice",
    r"keep (?:\w+ ){0,3}(?:small|low|down|lean|slim|minimal|light)", "keep it low", "keep it small",
    "keep off", "kind to", "klein halten", "klein wie", "kleinhalten", "knapp halten",
    "knapp zu halten", "knausrig", "kostbar", "kuerzer treten", "kurz halten", "lean", "less",
    "lid on", "light", "light on", "lightly", "little", "load off", "low", "lower", "luft laesst",
    "luft lassen", "massvoll", "mindful", "minimal", r"minimier\w*", r"minimi[sz]e\w*", "minimum",
    r"moderate\w*", r"modest\w*", "moeglichst wenig", "nachsicht", "nibble", "nice to",
    "nicht so viel", "nicht soviel", "nicht zu viel", "nicht zuviel", "niedrig", "niedrig wie",
    "not so much", "not too much", "offload", "on a budget", "pause", "penny", "pfleglich", "pinch",
    "pinching", "precious", "pressure off", r"reduc\w*", r"reduzier\w*", "rein in", "rein it in",
    "relieve", "ressourcenschonend", r"restrain\w*", "restraint", r"restrict\w*", "runter",
    "runterfahren", "runterschrauben", "sachte", "saeubern", "save", "saves", "saving",
    "scale back", "schone", "schonen", "schonend", "schont", "schonung", r"schraenk\w*", "senke",
    "senken", r"shrink\w*", "sinnig", "sip", r"skimp\w*", "slim", "smaller", "so wenig", "sorgsam",
    "spar", "spare", "sparen", "sparflamme", "sparing", r"sparing\w*", "sparingly", "sparmodus",
    "sparsam", "sparsamer", r"sparse\w*", "spart", "stay off", "stingy", "strain off", "suutje",
    "thrift", "thrifty", "throttle", "tight", "tone down", "too much", r"trim\w*", "turn down",
    "unload", r"verringer\w*", "vorsichtig", "weight off", "wenig", "weniger", "zuegeln",
    "zurueckfahren", r"zurueckhalt\w*", "zurueckhaltend", "zurueckhaltung", "zurueckschrauben",
)  # fmt: skip
WASTE = any_of(
    r"belast\w*", "bog down", r"burden\w*", "burn", "burning", r"chok\w*", r"clog\w*",
    r"congest\w*", "dicht machen", "eat up", "eating up", r"eng(?! (?:zu )?halt\w*)", r"exhaust\w*",
    r"flood\w*", "fry", "gluehen lassen", r"hammer\w*", "hog", "hogging", "hogs", "ins schwitzen",
    r"jam\w*", r"knapp(?! (?:zu )?halt\w*)", "max out", "maxing", "melt", r"overload\w*",
    r"overus\w*", "rar", "running low", r"saturat\w*", "scarce", "schwitzen", "short of",
    "short on", "squander", r"strain\w*", r"strapazier\w*", r"stress\w*", r"swamp\w*", "sweat",
    r"tax\w*", "tight on", "ueberfluten", "ueberfordern", r"ueberlast\w*", r"ueberstrapazier\w*",
    r"verbrat\w*", r"vergeud\w*", "verheizen", r"verschwend\w*", r"verstopf\w*", "volldroehnen",
    r"vollmach\w*", "waste", "wasting", "weigh down", "zuballern", "zumachen", r"zumuell\w*",
)  # fmt: skip
"""With a negation: save."""
STOP = any_of(
    "aufhoeren", "avoid", "cease", "enough", "lay off", "less", "no more", "quit", "schluss",
    "stop", r"vermeid\w*", "weniger",
)  # fmt: skip
"""With waste: save."""
