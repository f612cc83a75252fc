"""Words by which a wish tells what is to be done with what it names, in English and German.

Patterns read a clause as `clauses` writes it: folded words, and what is named in capitals.
"""

from __future__ import annotations

import re


def _any(*patterns: str) -> re.Pattern[str]:
    return re.compile(r"\b(?:" + "|".join(patterns) + r")\b")


NOT = _any(
    "havent", "hasnt", "hardly", "neva", "niemals mehr", "nimmer", "net", "nich", "nee", "nope",
    "nimma", "keinerlei", "keines", "keinesfalls", "auf gar keinen fall",
    "under no circumstances", "not at all", "in no case", "unter keinen umstaenden",
    "dont", "do not", "doesnt", "does not", "never", "not", "no", "cannot", "cant", "must ?nt",
    "neednt", "shouldnt", "arent", "isnt", "wont", "neither", "nicht", "ned", "net", "nie",
    "niemals", "kein", "keine", "keinen", "keiner", "keinem", "keinesfalls", "keineswegs",
    "nichts", "nix", "auf keinen fall", "didnt", "need ?nt",
)  # fmt: skip
OUT = _any(
    r"ground\w*", "park", "parked", "parking", r"sideline\w*", r"shelve\w*", "sleep", "sleeps",
    "sleeping", "stand down", "stands down", "stand by", r"ditch\w*", "axe", r"unplug\w*",
    r"retire\w*", r"quarantine\w*", r"blacklist\w*", r"suspend\w*", r"withdraw\w*", "day off",
    "cut out", "rule out", "count out", "take out", "opt out", "make do without", "do without",
    "get by without", "go without", "manage without", "unavailable", "not available", "inactive",
    "deactivated", "disabled", "lock out", "locked out", "leave behind", r"stays? home",
    "at home", "knock off", "scrap", "turn off", "switch off", "standby", r"park\w*t", "geparkt",
    "parken", "abmelden", "abgemeldet", r"aussortier\w*", "rauswerfen", "rauswirf", "wirf raus",
    r"rausschmeiss\w*", r"schmeiss\w* raus", r"kick\w*", "wegfallen", "entfaellt",
    r"ausklammer\w*", r"klammer\w* aus", "abziehen", "abgezogen", "aussetzen", "setzt aus",
    "aussetzt", "pausiert", "schlafen", "schlaeft", r"kaltstell\w*", "kaltgestellt",
    r"blockier\w*", r"stillleg\w*", "stillgelegt", r"deaktivier\w*", "ausgeschaltet",
    "ausschalten", r"schalt\w* ab", "abgeschaltet", "abstellen", "abgestellt", r"abzieh\w*",
    "herausnehmen", "rausgenommen", "herausgenommen", "weggelassen", "ausgelassen",
    "ausgeschlossen", "ausgenommen", "ausgespart", "aussparen", "fernbleiben", "wegbleiben",
    "wegbleibt", "raushalten", "nicht verfuegbar", "ausser dienst", "off duty", "out of service",
    "out of action", "ausser betrieb", "im urlaub", "haende weg", "fern halten", "liegen lassen",
    "links liegen", "stehen lassen", "stehenlassen", "zu hause", "nix von", "nichts wissen",
    "absehen", "verzichten", "verzichtet",
    r"skip\w*", r"ignor\w*", r"exclud\w*", "drop", "dropping", "omit", "bench", "disable",
    "deactivate", "avoid", "remove", "without", "except", "besides", "excluding", "out", "off",
    "aside", "ALLBUT", "rest", "pause", "a break", "forget", "forget about", "spare",
    r"stop \w*", "in peace", r"(?:leave|leaving|lev|leaf|let) .*\b(?:alone|be|rest|sleep)",
    r"(?:leave|leaving|lev|leaf) (?:it|them|him|her)", "let it", "let them", "let him",
    "leave ROBOT", "leave it", "alone",
    r"left (?:alone|out|in peace|off|aside)", "ruhe gelassen", "nothing from", "nichts von",
    "zufrieden", "ruhe", "mit ausnahme", "with the exception",
    "exception", "disregard",
    r"(?:keep|stay) (?:\w+ )?away", "steer clear", "hold off", "lay off", "taboo",
    "tabu", "no go", r"finger (?:weg|von)", "raushalten", "heraushalten", "fernhalten",
    r"verschon\w*",
    "sit out", "out of bounds", "banned", "verboten", "gesperrt", "stay home", "daheim", "zuhause",
    "nicht dabei", r"entbehr\w*", "forbidden", "opt out", "hinauslassen", "pass over",
    r"scheid\w* aus",
    "ohne", "ausser", "auslassen", "auslass", "lass aus", "weglassen", "weg", "raus", "aus",
    "rauslassen", r"ausschliess\w*", r"schliess\w* .*", "ausnehmen", r"ignorier\w*", r"verzicht\w*",
    r"uebergeh\w*", r"pausier\w*", "pausen", r"abschalt\w*", r"sperr\w*", "in ruhe", "aussen vor",
    "draussen", "nichts hoeren", "vergiss", "vergessen", "meide", "vermeide", r"streich\w*",
    "rausnehmen", "auszulassen", "lahmlegen", "stilllegen", "beiseite", "fern", "ruhen",
)  # fmt: skip
UNUSED = _any(
    "plan on", "schedule", "scheduled", "assign", "deploy", "pick", "choose", "select", "rely on",
    "einplanen", "eingeplant", "verplanen", r"beruecksichtig\w*", "einbinden", "eingebunden",
    "ansprechen", "angesprochen", r"heranzieh\w*", "herangezogen", r"hinzuzieh\w*", "zuziehen",
    r"beizieh\w*", r"auswaehl\w*", "waehlen", "waehl", "zaehlen auf", "verlassen", "bauen",
    "setzen", "hoeren", "rufen", "anrufen", r"kontaktier\w*", "abfragen", "befragen",
    r"behellig\w*", "einspannen", r"beanspruch\w*", "mitwirken", "mitspielen", r"mitzieh\w*",
    "ran", "dran", "drannehmen", "schicken", "losschicken", "zum einsatz",
    r"us(?:e|ed|ing)", "ask", "asked", "asking", "bother", "touch", "take", "include", "call",
    "query", "disturb", "count on", "consult", "consulted", "poll", "want", "need", "depend",
    "listen", "trust", "employ", "bothered", "disturbed", "let", "go", "fragt", r"bemueh\w*",
    "heranziehen", "hinzuziehen", "nutzen", "nutz", "nutze", "belaestigen", "ranlassen", "dabei",
    "query", "disturb", "involve", "request", "requests", "part", "participate", "rely", "contact",
    "gefragt", "gestoert", "benutzt", "genommen", "verwendet", "eingesetzt", "angefragt",
    "einbezogen", "bothered", "queried", "contacted", "benutzen", "benutz", "benutze",
    "verwenden", "verwende", "nehmen", "nimm", "fragen", "frag",
    "frage", "mitmachen", "einsetzen", "stoeren", "stoer", "mitnehmen", "anfragen", "brauchen",
    "brauch", "brauche", "brauchma", "einbeziehen", "beteiligen", "teilnehmen", "anfassen",
)  # fmt: skip
"""What is done with a robot; with a negation, it is left out."""
ONLY = _any(
    "just ROBOT", "purely", "merely", "nothing but", "and thats it", "and thats all", "sole",
    "alone may", "and no other", "and no others", "none of the others", r"und sonst keine[rn]?",
    r"und keine[rn]? sonst", "und kein anderer", "und keinen anderen", "blos", "allein ROBOT",
    "nix anderes", "niemanden sonst", "kein anderer", "keine andere", "und fertig", "und basta",
    "bloss ROBOT", "einzig und allein", r"beschraenk\w* .*\bauf ROBOT",
    "only", r"(?:limit|restrict|confine|reduce)\w* .*\bto ROBOT", "stick with", "stick to",
    "keep to", "solely", "exclusively", "exclusive",
    "NOBODYBUT", "nobody else", "no one else",
    "none else", "noone else", "nothing else", "no other", "no others", "restrict", "nur",
    "ausschliesslich", "einzig", "lediglich", "sonst niemand", "sonst niemanden", "sonst keiner",
    "sonst keinen", "niemand sonst", "reicht", "reichen", "genuegt", "genuegen", "is enough",
    "are enough", "suffices", "suffice", "niemand anderes", "allein", "und sonst",
    "die anderen brauch", "limit yourself to ROBOT", "keine anderen", "keinen anderen",
)  # fmt: skip
JUST = _any("just", "bloss", "purely", "merely")
FIRST = _any(
    "first choice", "first pick", "top choice", "favourite", "favorite", "preferably",
    "over the others", "over all others", "over the rest", "before anybody", "vor den anderen",
    "erste adresse", r"favorit\w*", "als erste", "zu allererst", "zuallererst", "vorziehen",
    "vorgezogen", r"ziehe? vor", "den vortritt", "vortritt", "vorfahrt", "geht vor", "gehen vor",
    "first", r"prefer\w*", "rather", "priority", "prioriti[sz]e", r"favou?r\w*", "before everyone",
    "before everybody", "before the others", "before the rest", "before all", "before anyone",
    "start with", "at the top", "top of", "ideally", "begin with", "as first", "ahead of",
    "zuerst", r"bevorzug\w*",
    "vorrang", "vorzug", "am liebsten", "lieber", "erste wahl", "vorzugsweise",
    "als erstes", "als ersten", "vor allen", r"priorisier\w*", "primarily",
    "zunaechst",
    "erster", "als erster", "wann immer moeglich", "go ahead of",
    "allen voran", "erste",
)  # fmt: skip
POSSIBLY = _any(
    "lean on", "lean more on", "go to", "goto", "go for", "turn to", r"where(?:ver)? you can",
    r"where(?:ver)? possible", "mainly", "mostly", "chiefly", "above all", "vor allem",
    "as often as possible", "as much as possible", "whenever it works", "gern", "gerne",
    "for starters", "first of all", "wo es geht", "wo moeglich", "so oft es geht",
    "so oft wie moeglich", "erstmal", "hauptsaechlich", "vornehmlich", "in erster linie",
    "default to", "best bet", "if it works", "if it is possible", "if at all possible",
    "wenns geht", "wenns klappt", "wenns passt", "wenn es klappt", "wenn es passt",
    "sofern moeglich", "nach moeglichkeit", "where you can", "where possible",
    "wherever possible",
"if possible", "if you can", "wenn moeglich", "moeglichst", "wenn es geht",
                "whenever possible", "whenever you can", "wann immer moeglich",
                "falls moeglich")  # fmt: skip
"""A preference of what is named, or politeness beside another cue."""
NOT_BUT_OUT = _any(
    "nichts hoeren", "nichts wissen", "nicht dabei", "no go", "nicht verfuegbar", "not available",
    "nothing from", "nichts von", "nix von", "nix wissen", "nix hoeren", "nichts mehr hoeren",
)  # fmt: skip
"""Negations that mean "out", rather than negate it."""
OVER_OTHERS = re.compile(
    r"\b(?:over|before|ahead of|rather than|vor|lieber als) "
    r"(?:(?:all|the|den|allen|everyone) ){0,2}"
    r"(?:rest|others?|anderen|else|uebrigen|everyone)\b"
)
OTHERS = _any(
    r"(?:every|any) ?(?:one|body|thing|robot) else",
    r"(?:all |alle )?(?:the |die |den |der )?(?:rest|others?|other (?:ones|robots|bots)|remaining"
    r"(?: ones| robots)?|anderen|uebrigen|restlichen)(?: robots?| robotern?| ones)?", "alle andern",
)  # fmt: skip
"""All robots but those that are named beside them."""
BACKUP = _any(
    r"back ?ups?", "reserve", "fallback", "second", "secondary", "if needed", "if necessary",
    "as needed", "when needed", "notfalls", "im notfall", "zur not", "ersatz", "danach",
    "afterwards", "later", "spaeter", "zweite wahl", "second choice", "hinten an", "hintenan",
    "erst danach", "nachrangig", "last", "zuletzt", "in reserve", "in an emergency", "as a spare",
    "bei bedarf", "nachher", "erst dann", "next", "after that",
)  # fmt: skip
"""Said of the others: who is named comes first."""
IDLE = _any(
    "hands off", "stay put", "stay out", "stand by", "stand down", "idle", "quiet", "silent",
    "keep quiet", "wait", "sleep", "rest", "warten", "schlafen", "still", "sit out", "keep out",
    "hold still", "go home", "pausieren", "schweigen", "nothing", "nichts", "stumm",
)  # fmt: skip
"""Said of the others: only who is named is asked."""
LAST = _any("last", "lastly", "zuletzt", "als letztes", "als letzter", "worst", "least")
HIGH = _any(
    r"(?:is|are|sind|ist) (?:really |very |sehr )?hot", r"hot ?spots?", r"hawk\w*", "sharp",
    "sharper", "harder", "closer", "peeled", r"vigilan\w*", r"scrutin\w*", r"inspect\w*",
    "keep tabs", "tabs", "top", "main thing", "mainly", "mostly", "matters most", "most of all",
    "especially", "particularly", "particular", "extra", "prime", "primary", "urgent", "foremost",
    "focal", r"hotspots?", "decisive", "significant", r"highlight\w*", "stare", "gaze",
    "spotlight", "survey", r"surveill\w*", r"patrol\w*", "pay", "zoom in", "all over",
    "vor allem", "vor allen", "insbesondere", "hauptsaechlich", "besondere", "besonderes",
    "besonderen", "vorfahrt", "vortritt", "an erster stelle", "erster stelle", "oberste",
    "hoechste", "hinsehen", "hingucken", "hinguckt", "hinschaut", "anschauen", "anschaut",
    "ansehen", "anseht", "angucken", r"beachte\w*", "beaugen", r"beaeug\w*", "obacht", "wachsam",
    "scharf", "schaerfer", "genaustens", "genauestens", "brandgefaehrlich", "brenzlig", "heikel",
    "brisant", "brennt", "am herzen", r"priorisier\w*", "vorzug", "spannend", "augenmerk",
    r"hinschau\w*", "aufzupassen", "zu achten", r"verfolg\w*", r"kontrollier\w*", "sichern",
    "absichern", "behaltet", r"hervorheb\w*", r"hab\w* ein auge", "vorziehen", r"gut sicht\w*",
    "drauf", r"dringend\w*", "im fokus", "fokus", r"wesentlich\w*", "essenziell", "zentral",
    "ruecksicht", r"above (?:all|everything|anything)", "more weight", "gewicht", "weight",
    r"vorrangig\w*",
    r"ueber alles?", "oefter", "haeufiger", "genau", "genauer", "sicherheit", "pay heed", "heed",
    "watch", "watching", "watch out", "wacth", "wach", "eye", "eyes", r"focus\w*", "look",
    "looking",
    "important", "importance", "matter", "matters", "attention", "attentive", "priority", "high",
    "higher", "first", "count", "counts", "key", "worry", "worried", "careful", "carefully",
    "interested", "interesting", "interest", "safety", "concentrate", "dangerous", "monitor",
    "crucial", "critical", "vital", "care", "see", "beware", "alert", "mind", "closely", "more",
    "observe", "guard", "cover", "emphasi[sz]e", "emphasis", "essential", "relevant", "vigilant",
    "track", "keep an eye", "in view", "in sight", "prioriti[sz]e", "caution", "cautious",
    "protect",
    "concern", "concerned", "concerns", "keen", "check", "paramount", "precious", "supervise",
    "achte", "achten", "acht", "achtet", "achtung", "aufpassen", "pass auf", "passt auf", "aufs",
    "auge", "augen", r"wichtig\w*", "vorrang", "vor allem", "besonders", "vorsicht", "schau",
    "schaut", "schauts", "schauen", "hoch", "hohe", "hoher", r"gut sehen", "gehen vor", "geht vor",
    r"beobacht\w*", r"konzentrier\w*", "im blick", "interessant", "interessieren", "interessiert",
    "zuerst", "aufmerksam", "aufmerksamkeit", "mehr", "kuemmer", "kuemmere", r"ueberwach\w*",
    "prioritaet", "entscheidend", "zaehlt", "zaehlen", "fokus", r"fokussier\w*", "gefaehrlich",
    "relevant", "sehen", "sieh", "gucken", "guck", "guckt", "hinschauen", "merk", r"bewach\w*",
    "pass", "schuetzen", "schuetz", "sorgen", "hauptsache", "kritisch", "schwerpunkt", "blick",
)  # fmt: skip
LOW = _any(
    r"brauch\w* (?:keiner|niemand)", r"interessier\w* (?:keinen|niemanden)", "nobody needs",
    "dont care", "do not care", "couldnt care less", "not so much", "not that much",
    "not as much", "not really", "not a priority", "doesnt count", "can wait", "could wait",
    "may wait", "warten", "kann warten", "koennen warten", "not worth", "not interested",
    "no interest", "leave out", "out of scope", "off the radar", "back burner", "unattended",
    r"deprioriti[sz]e\w*", "low priority", "dull", "deserted", "trivial", "immaterial",
    "beside the point", "no matter", "let slide", "relax about", "unimportant", "superfluous",
    "nobody there", "kein interesse", "nicht so", "nicht sonderlich", "nicht besonders",
    r"hintanstell\w*", r"hintenan\w*", r"zurueckstell\w*", "weglassen", "auslassen",
    r"ausblend\w*", "zu vergessen", "unbedeutend", "unbeachtet", r"uebergeh\w*", "uebersehen",
    "unbeobachtet", "nebensache", "unnoetig", r"langweilig\w*", r"unwesentlich\w*", "abhaken",
    "knicken", "aussparen", "zu vernachlaessigen", "geschenkt", "piepegal", "scheissegal",
    "latte", "pupsegal", "kuemmert keinen", "juckt keinen", "juckt niemanden", r"zweitrangig\w*",
    r"nachrangig\w*",
    "fewer", "lose sight", "lose track", "aus den augen", "aus dem auge", "unimportant",
    "irrelevant",
    "uninteresting", r"neglect\w*", r"ignor\w*", "forget",
    "forget about", "never mind", "less", "low", "lower", "no need", r"skip\w*", "nothing happens",
    "nothing happening", "disregard", "negligible", "nobody cares", "who cares", "meaningless",
    "dont bother", "drop", "secondary", "boring", "overlook", "without", "empty", "indifferent",
    "minor", "least", r"unwichtig\w*", "egal", "vergiss", "vergessen", "weniger",
    r"vernachlaessig\w*",
    "niedrig", "niedrige", "nebensaechlich", r"ignorier\w*", "uninteressant", "wurscht", "wurst",
    "unerheblich", "leer", "belanglos", "schnuppe", "ohne", "ausser acht", "links liegen",
    "zweitrangig", r"verzicht\w*", "nachrangig", "pfeif", "bedeutungslos",
)  # fmt: skip
SAVE = _any(
    "ease", "eases", "easing", "ease off", "ease up", "load off", "strain off", "pressure off",
    "weight off", "off the", "back off", "dial down", "dial back", "scale back", "cut back",
    "cut down", "hold back", "tone down", "turn down", "rein in", r"trim\w*", r"shrink\w*",
    r"restrain\w*", "restraint", r"modest\w*", r"moderate\w*", r"sparse\w*", "precious",
    "as little", "not so much", "not too much", "too much",
    "slim", "keep it small", "keep it low", "smaller", "fewer", "careful",
    "carefully", "mindful", r"curb\w*", r"alleviat\w*", "unload", "offload", "lean",
    "dont overdo", "budget", r"economical\w*", r"sparing\w*", r"gering\w*", "geringhalten",
    r"minimier\w*", r"einschraenk\w*", r"schraenk\w*", "zurueckfahren", "runterfahren",
    "herunterfahren", r"zurueckhalt\w*", "zurueckhaltend", "behutsam", "vorsichtig", "massvoll",
    "sparflamme", "kuerzer treten", "schonung", "nicht so viel", "nicht zu viel",
    "nicht soviel", "nicht zuviel", "so wenig", "moeglichst wenig", "ressourcenschonend",
    "haushaltet", "sorgsam", "kostbar", "runterschrauben", "zurueckschrauben",
    "drosseln", r"abspeck\w*", "saeubern", "klein halten", "kleinhalten",
    "minimum", "minimal", "save", "saving", "saves", "spare", "sparing", r"econom\w*", "thrifty",
    "thrift", r"conserv\w*",
    r"reduc\w*", "lower", "less", "little", "easy", "cut", r"minimi[sz]e\w*", "low", "down",
    "gentle",
    "gently", "light", "lightly", "frugal", "tight", "stingy", "economise", "relieve", "sparingly",
    r"spar", "spare", "sparen", "spart", "sparsam", "sparsamer", "einsparen", "schone", "schonen",
    "schont", "schonend", "weniger", "wenig", "sachte", "niedrig", r"entlast\w*", "runter",
    r"reduzier\w*", r"verringer\w*", "geizig", "haushalten", "knausrig", "senke", "senken",
    r"drossel\w*",
    "throttle", "haushalte",
)  # fmt: skip
AT_LEAST = _any(
    "no lower", "not lower", "or higher", "at least", "no less than", "not less than", "minimum",
    "min", "minimal", "above", "or better",
    "or more", "not drop below", "not fall below", "never below", "not below", "not under",
    "never under", "never go under", "not go under", "drop below", "fall below", "go below",
    "go under",
    "below", "under", "floor", "better than", "mindestens", "wenigstens", "minimum", "nicht unter",
    "zumindest", "ueber", "oder mehr", "oder besser", "nicht weniger", "nie unter", "unter",
    "not sink below", "not get below", "not less", "least",
)  # fmt: skip
AT_MOST = _any(
    "at most", "no more than", "not more than", "more than", "maximum", "max", "up to", "cap",
    "limit", "at maximum", "hoechstens", "maximal", "nicht mehr", "mehr als", "bis zu",
    r"beschraenk\w*",
    r"begrenz\w*", "ceiling", "not exceed", "exceed", "ueberschreiten", "not above",
)  # fmt: skip
FREE = _any("free", "reserve", "reserved", "frei", "freihalten", r"reservier\w*", "freilassen",
            "leave", "others", "andere", "anderen", "unused", "untouched", "spare")  # fmt: skip
"""The part is that which is kept for others."""
WASTE = _any(
    "short on",
    "short of",
    "running low",
    "tight on",
    "scarce",
    "knapp",
    "rar",
    "eng",
    r"hammer\w*",
    r"flood\w*",
    r"clog\w*",
    r"hog",
    r"hogs",
    r"hogging",
    r"saturat\w*",
    r"overload\w*",
    r"overus\w*",
    "max out",
    r"maxing",
    r"chok\w*",
    r"swamp\w*",
    r"burden\w*",
    r"strain\w*",
    r"stress\w*",
    r"tax\w*",
    r"congest\w*",
    r"exhaust\w*",
    r"jam\w*",
    "eat up",
    "eating up",
    "burn",
    "burning",
    r"ueberlast\w*",
    r"belast\w*",
    r"zumuell\w*",
    r"verstopf\w*",
    r"strapazier\w*",
    r"vollmach\w*",
    "volldroehnen",
    "zuballern",
    r"ueberfluten",
    r"ueberfordern",
    "dicht machen",
    "zumachen",
    r"verbrat\w*",
    "verheizen",
    r"ueberstrapazier\w*",
    "waste",
    r"wasting",
    r"verschwend\w*",
    r"vergeud\w*",
    "squander",
)
"""With a negation: save."""
AGAIN = _any("again", "back", "wieder", "undo", "cancel",
             "revert", "zurueck", "return")  # fmt: skip
"""Takes back rather than wishes."""
STOP = _any("stop", "quit", "cease", "lay off", "enough", "schluss", "aufhoeren", "no more",
            "avoid", "less", "weniger", r"vermeid\w*")  # fmt: skip
"""With waste: save."""
BOTH = _any("both", "pair", "the two", "the lot", "beide", "beiden", "these two", "die zwei",
            "all of them", "all three", "alle drei", "neither", "either of them", "sie alle",
            "keinen von ihnen", "keinen von beiden")  # fmt: skip
"""Several that were named one by one."""
PRONOUN = _any(
    "both",
    "the pair",
    "the two",
    "beide",
    "beiden",
    "her",
    "that one",
    "diesen",
    "it",
    "them",
    "him",
    "they",
    "ihn",
    "ihm",
    "these",
    "those",
    "this one",
)
PAST = _any(
    r"(?:we|they|i|wir) (?:used|asked|left|skipped|ignored|watched|nutzten)",
    "was", r"(?<=[a-zA-Z] )were", "had", "did", "wurde", "wurden", "hatte", "hatten",
    "used to",
            "has been", "have been", "been", "yesterday", "war", "waren",
            "gestern", "went", "took", "didnt", "wasnt", "worden")  # fmt: skip
POLITE = re.compile(
    r"\b(?:i was (?:wondering|hoping)|i wanted to ask|ich wollte (?:fragen|bitten)|"
    r"it would be (?:nice|great|good)|ich waere dankbar|waert ihr so nett)"
    r"(?: (?:if|whether|that|ob|wenn|dass))?\b"
)
"""Opens a wish as if it told or asked something."""
TOLD = re.compile(
    r"\b(?:got|had|broke|fell|failed|lost|hit|crashed|came|started|stopped|hat|"
    r"haben|hatte|wurde|war|seit|since|kam|fiel|was|were)\b(?! (?:to|zu)\b)"
)
"""Tells what happened, beside a time that is over."""
QUESTION = re.compile(
    r"^(?:what(?! (?:matters|counts|is important|i (?:want|need)))|which|who|whom|whose|why|how|"
    r"when|where|is|are|am i|does|did|has|have|should|shall|"
    r"was|"
    r"were (?:you|they|there|those|these|ROBOT)|"
    r"do (?:you|we|i|they)|can (?:i|we|r|ROBOT)|could (?:i|we)|must|may|will (?:ROBOT|the|it)|"
    r"wie|was(?! (?:zaehlt|wichtig))|warum|wer|wen|wem|welche[rsnm]?|wo|wann|wieso|weshalb|soll|"
    r"sollen|sollte|ist|sind|"
    r"wird|hat|haben|darf|muss|gibt|kann (?:ich|man|ROBOT)|koennen wir|bist|weisst)\b"
)
DOUBTED = re.compile(
    r"\b(?:should (?:i|we)|shall (?:i|we)|soll ich|sollen wir|sollte ich|i wonder|frage mich|maybe|"
    r"perhaps|vielleicht sollte\w*)\b"
)
"""Asks, wherever it stands."""
CONDITION = re.compile(
    r"\b(?:if|unless|falls|sobald|as soon as|wenn|in case|sofern|when|whenever|once)\b"
)
NO_CONDITION = re.compile(
    r"\b(?:if (?:possible|you can|you could|you please|need be|you dont mind|you would|at all)|"
    r"when(?:ever)? you can|(?:would|waere|wuerde) (?:\w+ ){0,3}(?:if|wenn)|wenn (?:moeglich|"
    r"es geht|ihr|du|geht|moeglich|ROBOT mitmach\w*)|"
    r"if you like|when possible)\b"
)
CONTRAST = re.compile(
    r"\b(?:not|nicht) (?:the )?ROBOT (?:but|sondern)\b|\bsondern\b|\binstead of\b"
)
FOREIGN = re.compile(
    r"[\"“”„«»{}<>`|\\=]{1}(?!\s*(?:ROBOT|TIME|SHARE))|\b(?:system|assistant|user) ?:|\b(?:"
    r"says?|said|sagt|sagte|reports?|meldet|nachricht|message|reads|steht|repeat|translate|"
    r"uebersetz\w*|instructions?|instruktion\w*|prompt|anweisung\w*|you are (?:now|a|an)|du bist|"
    r"ab jetzt bist|pretend|role ?play|maintenance mode|your rules|all rules|deine regeln|"
    r"alle regeln|"
    r"previous|vorherigen|tell me|erzaehl\w*|joke|witz|json|output|print|admin|root|override|"
    r"jailbreak|"
    r"stell dir vor|imagine|hypothetically|story|geschichte|poem|gedicht|wrote|schrieb|told|"
    r"asked me|"
    r"the following|a test|ein test|operators?|obeys?|gehorch\w*|hoerst du|hoer auf|"
    r"claims?|behauptet|announces?|tells|demands?|verlangt|quote|zitat|schild|sign)\b"
)
"""Words of a robot, of a text, to a model: nobody's wish."""
EVERYBODY_OUT = re.compile(r"\b(?:every ?(?:one|body)|all|alle|jeden)\b")

SPELLING = frozenset(
    """nicht never without except ignore exclude leave alone prefer nobody niemand watch important
    quality qualitaet mindestens wenigstens wichtig ausser zuerst bevorzuge benutzen verwenden
    ignorieren ausschliessen weglassen auslassen hoechstens maximal least shouldnt doesnt matter
    attention unwichtig achte below under unter nichts keinen keiner fallen drop ausschliesslich
    exclusively first please reduce sparen avoid should shall""".split()  # noqa: SIM905
)
"""Words in which one slip of the keyboard is forgiven, or which one slip makes of another."""

KNOWN = frozenset(
    word
    for pattern in tuple(globals().values())
    if isinstance(pattern, re.Pattern)
    for word in re.findall(r"[a-z]{3,}", pattern.pattern)
)
"""Words that are cues themselves, or parts of one: never slips of another."""
