"""Words by which a wish leaves robots out, asks nobody else, or asks them first."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

OUT = any_of(
    "ALLBUT", "a break",
    "(?:a |eine |ne )?(?:auszeit|verschnaufpause|breather|breathing space|time out|timeout)",
    "a miss", "abgemeldet", "abgeschaltet", "abgestellt", "abgezogen", "abmelden", r"abschalt\w*",
    "absehen", "abstand nehmen", "abstellen", r"abzieh\w*", "abziehen", "alone", "arent available",
    "aside", "at home", "auf der reservebank", "auf die bank", "auf eis", "aufs abstellgleis",
    "aus", "aus dem rennen", "aus dem spiel", "aus dem verkehr", "aus dem verkehr ziehen",
    "aus der auswahl", "aus der liste", "ausgelassen", "ausgeliehen", "ausgenommen", "ausgeplant",
    "ausgeschaltet", "ausgeschlossen", "ausgespart", r"ausklammer\w*", "auslass", "auslassen",
    "ausnehmen", "ausplanen", "ausschalten", r"ausschliess\w*", "aussen vor", "ausser",
    "ausser betrieb", "ausser dienst", "ausser gefecht", "aussetzen", "aussetzt", r"aussortier\w*",
    "aussparen", "auszulassen", "avoid", "axe", "banned", "barred",
    "(?:been )?(?:loaned|lent)(?: out)?",
    "beiseite", "bench", "benched", "besides", r"beurlaub\w*", r"blacklist\w*", r"blockier\w*",
    "count out", "cross off", "cut out", "daheim", "day off", "deactivate", "deactivated",
    r"deaktivier\w*", "die finger", "disable", "disabled", "disregard", r"ditch\w*", "do without",
    "draussen", "drop", "dropping", "einen bogen", r"entbehr\w*", "entfaellt", "except",
    "exception", r"exclud\w*", "excluding", "excused", "feet up", "fern", "fern halten",
    "fernbleiben", "fernhalten", "finger davon", "finger weg", "finger (?:weg|von)", "forbidden",
    "forget", "forget about", "freigestellt", "from the list", "geparkt", "geschont", "gesperrt",
    "get by without", "go without", "haende weg", r"halt\w* ROBOT frei", r"halt\w* ROBOT zurueck",
    "hands off", "hausarrest", "herausgenommen", "heraushalten", "herausnehmen", "hinauslassen",
    "hold off", "(?:hold|held|keep|kept) (?:ROBOT |it |them )?back", r"ignor\w*", r"ignorier\w*",
    "im stall", "im urlaub", "in frieden", "in peace", "in ruh", "in ruhe", "inactive",
    "is not available", "isnt available", "kaltgestellt", r"kaltstell\w*", "keep ROBOT free",
    "keep clear", r"(?:keep|stay) (?:\w+ )?away", r"(?:keep|take|get)(?: \w+)? hands off",
    "kept out", "kick(?:ed|en|ing|s|t)?", r"klammer\w* aus", "knock off", "kommt nicht in frage",
    "krank geschrieben", "krankgeschrieben", r"krankmeld\w*", "lahmlegen", "lass aus",
    "lass stecken", "lay off", "leave ROBOT", "leave behind", "leave it",
    "(?:leave|leaving|lev|leaf) (?:it|them|him|her)",
    r"(?:leave|leaving|lev|leaf|let) .*\b(?:alone|rest|sleep)",
    r"(?:leave|let) (?:\w+ )+be(?: please| now| TIME)*$", "left (?:alone|out|in peace|off|aside)",
    "left out", "let him", "let it", "let them", "liegen lassen", "links liegen", "lock out",
    "locked out", "macht blau", "make do without", "manage without", "meide", "mit ausnahme",
    "nehmt abstand", "nicht dabei", "nicht verfuegbar", "nicht zur verfuegung", "nichts hoeren",
    "nichts von", "nichts wissen", "nix von", "no go", "not available", "nothing from", "off",
    "off duty", "off limits", "off our list", "off the books", "off the job", "off the list",
    "off the menu", "off the roster", "off the rota", "off the schedule", "off the table",
    "off the team", "ohne", "omit", "on leave", "on loan", "opt out",

    r"(?<!help )(?<!helps )out(?! (?:here|of (?:all|these|the (?:three|four|two)|them|those)|"
    r"there)\b)", "out of action",
    "out of bounds", "out of service", "out of the loop", "out of the picture", "out of the pool",
    "out of the running", "out of the sharing", "outta", "outta the pool", "park", "parked",
    "parken", "parking", r"park\w*t", "pass on ROBOT", "pass over", "pause", "pausen",
    r"pausier\w*", "pausiert", "please leave$", "pull", "pull ROBOT", "pulled", r"quarantine\w*",
    "raus", "rausgenommen", "raushalten", "rauslassen", "rausnehmen", r"rausschmeiss\w*",
    "rauswerfen", "rauswirf", r"refrain\w* from", "remove", "reservebank", "rest", r"retire\w*",
    "ruhe", "ruhe gelassen", "ruhen", "rule out", "runter von der liste", r"schalt\w* ab",
    r"scheid\w* aus", "schlaeft", "schlafen", r"schliess\w* .*", r"schmeiss\w* raus", "schonen",
    "scrap", "scratch ROBOT", "scratch ROBOT from", "send ROBOT (?:away|home)", "sendepause",
    "setzt aus", r"shelve\w*", r"shun\w*", "sick leave", r"sideline\w*", "sit out", r"skip\w*",
    "sleep", "sleeping", "sleeps", r"snub\w*",
    r"(?<!\ba )(?<!\bour )(?<!\bthe )(?<!\btheir )spare", "spared", r"sperr\w*", "stand by",
    "stand down", "standby", "stands down", "stay clear", "stay home", "stay out", "stays? home",
    "stays out", "steer clear", "stehen lassen", "stehenlassen", "stillgelegt", r"stillleg\w*",
    "stilllegen", r"stop \w*", r"streich\w*", "strike", r"suspend\w*", "switch off", "taboo",
    "tabu", "take out", "task", r"(?<!the )(?<!our )ground\w*", "turn off", r"uebergeh\w*",
    "unavailable", "unbehelligt", "unbothered", "undisturbed", "ungefragt", "ungestoert",
    r"unplug\w*", "verboten", "vergessen", "vergiss", "verliehen", "vermeide", r"verschon\w*",
    "verschont", r"verzicht\w*", "verzichten", "verzichtet", "vom plan", "von der liste", "weg",
    "wegbleiben", "wegbleibt", "wegfallen", "weggelassen", "weglassen", "wide berth", "wirf raus",
    "with the exception", r"withdraw\w*", "without", "write off", "zu hause", "zufrieden",
    "zuhause", "zurueckhalten",
)  # fmt: skip
UNUSED = any_of(
    "abfragen", "anfassen", "anfragen", "anfragt", "anfunken", "angefragt", "angefunkt",
    "angesprochen", "anpingen", "anrufen", "ansprechen", "anzufragen", "ask", "asked", "asking",
    "assign", "aushelfen", r"auswaehl\w*", "bauen", r"beanspruch\w*", "befragen", r"behellig\w*",
    r"beizieh\w*", "belaestigen", r"bemueh\w*", "benutz", "benutze", "benutzen", "benutzt",
    r"beruecksichtig\w*", "beteiligen", "bother", "bothered", "brauch", "brauche", "brauchen",
    "brauchma", "call", "choose", "consult", "consulted", "contact", "contacted",
    r"count\w* (?:\w+ ){0,3}in", "count on", "dabei", "depend", "deploy", "disturb", "disturbed",
    r"draft\w*", "drag in", "dran", "drannehmen", "einbeziehen", "einbezogen", "einbinden",
    "eingebunden", "eingeplant", "eingesetzt", "einplanen", "einsetzen", "einspannen", "employ",
    r"enlist\w*", "frag", "frage", "fragen", "fragt", "gebraucht", "gefragt", "geholt", "genommen",
    "gerufen", "gestoert", "go", "go near", r"harass\w*", r"hassl\w*", "helfen", "help", "helps",
    "herangezogen", r"heranzieh\w*", "heranziehen", r"heranzu\w*", r"hinzuzieh\w*", "hinzuziehen",
    "hoeren", "hol", "holen", "include", "involve", r"kontaktier\w*", "lean on", "let", "listen",
    "losschicken", "mithelfen", "mitmachen", "mitmacht", "mitnehmen", "mitspielen", "mitwirken",
    r"mitzieh\w*", r"nag\w*", "need", "needed", "nehmen", "nimm", "nutz", "nutze", "nutzen", "part",
    "participate", r"pester\w*", "pick", "ping", "pinged", "plan on", "poll", "queried", "query",
    "ran", "ranlassen", "rely", "rely on", "request", "requests", "rope in", "rufen", "ruft",
    "schedule", "scheduled", "schicken", "select", "setzen", "stoer", "stoeren", "take",
    "teilnehmen", "teilnimmt", "touch", "trust", "turn to", "us(?:e|ed|ing)", "verlassen",
    "verplanen", "verwende", "verwenden", "verwendet", "waehl", "waehlen", "want", "zaehlen auf",
    "zu fragen", "zum einsatz", "zuziehen",
)  # fmt: skip
"""What is done with a robot; with a negation, it is left out."""
NOT_BUT_OUT = any_of(
    "isnt available", "arent available", "kommt nicht in frage", "nicht zur verfuegung",
    "nichts hoeren", "nichts wissen", "nicht dabei", "no go", "nicht verfuegbar", "not available",
    "nothing from", "nichts von", "nix von", "nix wissen", "nix hoeren", "nichts mehr hoeren",
)  # fmt: skip
"""Negations that mean "out", rather than negate it."""
ONLY = any_of(
    r"(?:limit|restrict|confine)\w* (?:your|our)(?:self|selves) to ROBOT", r"mean ROBOT alone",
    r"(?:to|with|on|auf|mit) ROBOT (?:alone|allein)", r"ROBOT and ROBOT alone", "and only ROBOT",
    r"(?:der|die|das) einzige[nr]?,? (?:der|die|das|den) (?:ihr|wir|du)",
    r"(?:the )?only (?:ones?|robots?|bots?|units?) (?:you|we|to|that|who)", "solo", "full stop",
    "single handed", "by (?:itself|himself|herself|themselves)", "on (?:its|their) own",
    "im alleingang", r"im alleingang ROBOT", "all (?:by )?alone", "no helpers", "no help",
    "nothing and nobody else", "sonst brauchts niemand", "sonst braucht es niemand",
    "sonst darf keiner", "keinen sonst", "keine sonst", "keiner sonst", "sonst niemandem",
    r"no ?one (?:else|other)", "no other robots?", "no other bots?", "no other units?",
    "nobody other", "kein weiterer", "keine weiteren", "keinen weiteren", "mehr nicht", "sonst nix",
    "just ROBOT", "purely", "merely", "nothing but", "and thats it", "and thats all", "sole",
    "alone may", "and no other", "and no others", "none of the others", r"und sonst keine[rn]?",
    r"und keine[rn]? sonst", "und kein anderer", "und keinen anderen", "blos", "allein ROBOT",
    "nix anderes", "niemanden sonst", "kein anderer", "keine andere", "und fertig", "und basta",
    "bloss ROBOT", "einzig und allein", r"beschraenk\w* .*\bauf ROBOT", "only",
    r"(?:limit|restrict|confine|reduce)\w* .*\bto ROBOT",
    r"(?:keep|stick) (?:it|this|things|everything)(?: down)? (?:at|to|with) ROBOT",
    r"(?:belass|bleib)\w* (?:\w+ )?(?:es |wir |ihr )*bei ROBOT", "stick with", "stick to",
    "keep to",
    "solely", "exclusively", "exclusive", "NOBODYBUT", "nobody else", "no one else", "none else",
    "noone else", "nothing else", "no other", "no others", "restrict", "nur", "ausschliesslich",
    "einzig", "lediglich", "sonst niemand", "sonst niemanden", "sonst keiner", "sonst keinen",
    "niemand sonst", "reichts?", "reichen", "genuegts?", "its enough", "genuegen", "is enough",
    "are enough", "suffices", "suffice", "niemand anderes", "allein", "und sonst",
    "die anderen brauch", "limit yourself to ROBOT", "keine anderen", "keinen anderen",
)  # fmt: skip
JUST = any_of(
    "bloss", "just", "merely", "purely",
)  # fmt: skip
FIRST = any_of(
    "ace", "ahead of", "ahead of the pack", "allen voran", "als erste", "als ersten", "als erster",
    "als erstes", "am liebsten", "an die erste stelle", "an die spitze", "an erster stelle",
    "ans? erste[rs]?", "as first", "at the top", "before all", "before anybody", "before anyone",
    "before everybody", "before everyone", "before the others", "before the rest",
    "before you (?:bother|call|contact|query|turn to|ask|use|try|go to) (?:anyone|anybody|"
    "others?|the others?|any other)", "begin with", "best horse", "bestes pferd", "bevor du",
    "bevor ihr", r"bevorzug\w*", "den anderen vor", "den vortritt", "erst ROBOT", "erste",
    "erste adresse", "erste wahl", "erster", r"favorit\w*", "favorite", r"favou?r\w*", "favourite",
    "first", "first call", "first choice", "first dibs", "first in line", "first in the queue",
    "first pick", "first port of call", "first refusal", "first up", "gehen vor", "geht vor",
    "go ahead of", "go to robot", "ideally", "in preference to", "lead the way", "leads the way",
    "lieber", "number one", "nummer eins", "over all others", "over the others", "over the rest",
    r"prefer\w*", "preferably", "primarily", r"priorisier\w*", "prioriti[sz]e", "priority",
    "rather", "(?:shall|should|to|may|can|let ROBOT) lead",
    "sooner (?:you )?(?:asked|had|have|took|used|use|ask|take)", "start with", "take the lead",
    "takes the lead", "(?:than|before) (?:any of )?the others?", "top choice", "top of", "top pick",
    "vor allen", "vor (?:den )?anderen", "vor den anderen", "voran", "vorfahrt", "vorgezogen",
    "vornean", "vorneweg", "vorrang", "vorrangig", "vortritt", "vorziehen", "vorzug",
    "vorzugsweise", "wann immer moeglich", "ziehe? vor", "zu allererst", "zuallererst", "zuerst",
    "zunaechst",
)  # fmt: skip
POSSIBLY = any_of(
    "above all", "as much as possible", "as often as possible", "best bet", "chiefly", "default to",
    "erstmal", "falls moeglich", "first of all", "for starters", "gern", "gerne", "go for", "go to",
    "goto", "hauptsaechlich", "if at all possible", "if it is possible", "if it works",
    "if possible", "if you can", "in erster linie", "lean more on", "lean on", "mainly",
    "moeglichst", "mostly", "nach moeglichkeit", "so oft es geht", "so oft wie moeglich",
    "sofern moeglich", "turn to", "vor allem", "vornehmlich", "wann immer moeglich", "wenn es geht",
    "wenn es klappt", "wenn es passt", "wenn moeglich", "wenns geht", "wenns klappt", "wenns passt",
    "whenever it works", "whenever possible", "whenever you can", "where possible", "where you can",
    "where(?:ver)? possible", "wherever possible", "where(?:ver)? you can", "wo es geht",
    "wo moeglich",
)  # fmt: skip
"""A preference of what is named, or politeness beside another cue."""
LAST = any_of(
    "als letzter", "als letztes", "last", "lastly", "least", r"worst(?! (?:of|one)\b)", "zuletzt",
)  # fmt: skip
OVER_OTHERS = re.compile(
    r"\b(?:over|before|ahead of|rather than|in preference to|sooner than|vor|lieber als|eher als) "
    r"(?:(?:asking|bothering|taking|trying|using|you (?:ask|bother|take|try|use)) )?"
    r"(?:(?:all|any of|any|the|den|allen|anyone|anybody|everyone|everybody) ){0,2}"
    r"(?:rest|others?|anderen|else|uebrigen|everyone|everybody)\b"
)
CONTRAST = re.compile(
    r"\b(?:not|nicht) (?:the )?ROBOT (?:but|sondern)\b|\bsondern\b|\binstead of\b"
)
RATHER = re.compile(
    r"\b(?:lieber|rather|prefer\w*|eher|sooner|bevorzug\w*)\b.*\bROBOT\b.*"
    r"\b(?:als|than|over|statt) (?:(?:the|den|die|der|das) )?ROBOT\b|"
    r"^(?:please |bitte |and |und )?ROBOT (?:over|before|ahead of|vor) (?:(?:the|den|die|der|"
    r"das) )?ROBOT\b|\b(?:ask|fragt?|nehmt|nimm|take|try|use) "
    r"ROBOT (?:ahead of|before|vor) (?:(?:the|den|die|der) )?ROBOT\b|"
    r"\bROBOT (?:asked |polled |taken |tried |used )(?:ahead of|before) (?:the )?ROBOT\b|"
    r"\bROBOT (?:rather than|lieber als|eher als|in preference to) (?:(?:the|den|"
    r"die|der|das) )?ROBOT\b"
)
"""The first of two is preferred to the second."""
NEXT = re.compile(
    r"(?:(?:then|and|dann|und|with|mit) )*(?:(?:the|der|die|das) )?ROBOT (?:(?:the|your|dein|"
    r"deine|eure|as|als|is|ist|an|comes|kommt|on|auf) )*(?:second|next|third|after that|danach|"
    r"zweit\w*|dritt\w*|afterwards)(?: (?:best|choice|pick|place|wahl|stelle))?"
)
"""Goes on with a list of preferences."""
BUT_NOT = re.compile(
    r"\b(?:as long as|so long as|hauptsache|solange) (?:it |es )?(?:is |ist )?(?:isnt|not|nicht|"
    r"nich) (?:(?:der|die|das|the) )?ROBOT$|^(?:\w+ ){0,3}\b(?:nur|just|only|bloss|blos) "
    r"(?:bitte |please )?(?:not|nicht|net|ned|nich) "
    r"(?:(?:the|der|die|das|den) )?ROBOT$|^(?:just |only |nur |bloss )(?:(?:the|der|die|"
    r"den) )?ROBOT (?:not|nicht|net|ned|nich)$"
)
"""An exception from all: "just not R3"."""
DEMANDED = any_of(
    "(?:ha(?:s|ve)|needs?|ought) to (?:be (?:asked|in|included|used)|help|join|take part)",
    "(?:must|should) (?:be (?:asked|in|included|used)|help|join|take part)",
    r"(?:muss|muessen|soll|sollen|sollte|sollten) (?:\w+ )*?(?:dabei sein|gefragt werden|helfen|"
    r"mit|mithelfen|mitmachen|ran|rein)",
)  # fmt: skip
"""Somebody is to be asked in any case."""
