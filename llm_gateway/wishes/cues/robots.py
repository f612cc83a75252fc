"""Words by which a wish leaves robots out, asks nobody else, or asks them first."""

from __future__ import annotations

import re

from llm_gateway.wishes.cues.common import any_of

OUT = any_of(
    r"refrain\w* from", "abstand nehmen", r"nehmt abstand",
    "ausser gefecht", "einen bogen", "feet up", "hausarrest", "im stall", "kommt nicht in frage",
    "macht blau", "nicht zur verfuegung", "off the menu", "on leave", "on loan", r"pass on ROBOT",
    "reservebank", r"send ROBOT (?:away|home)", "sendepause", "sick leave", "wide berth",
    "isnt available", "is not available", "arent available",
    r"(?:hold|held|keep|kept) (?:ROBOT |it |them )?back", r"halt\w* ROBOT zurueck", "zurueckhalten",
    r"(?:a |eine |ne )?(?:auszeit|verschnaufpause|breather|breathing space|time out|timeout)",
    "schonen", "geschont", "auf der reservebank", "auf die bank", "benched",
    r"(?:keep|take|get)(?: \w+)? hands off", "hands off", "finger davon", "finger weg",
    r"die finger", "krankgeschrieben", "krank geschrieben", r"(?:been )?(?:loaned|lent)(?: out)?",
    r"verliehen", r"ausgeliehen", "off the list", "off our list", "from the list", "off the team",
    "off the job", "off the schedule", "off the books", "out of the running", "out of the loop",
    "out of the picture", "out of the sharing", "pull", "pulled", r"pull ROBOT", r"shun\w*",
    r"snub\w*", "stay clear", "stay out", "stays out", "keep clear", "kept out", "left out",
    r"unbehelligt", "ungefragt", "ungestoert", "undisturbed", "unbothered", "von der liste",
    "aus der liste", "vom plan", "runter von der liste", "aus der auswahl", "in ruhe", "excused",
    "write off", "strike", "scratch ROBOT", r"scratch ROBOT from", "cross off", r"krankmeld\w*",
    "aus dem verkehr", "aus dem verkehr ziehen", "aufs abstellgleis", "auf eis", "freigestellt",
    r"beurlaub\w*", "in frieden", "spared", "verschont", r"keep ROBOT free", r"halt\w* ROBOT frei",
    r"please leave$", "a miss", "out of the pool", "outta the pool", "outta", "off limits",
    "off the table", "task", "off the roster", "off the rota", "ausplanen", "ausgeplant",
    "aus dem rennen", "in ruh", "lass stecken", "aus dem spiel", r"ground\w*", "park", "parked",
    "parking", r"sideline\w*", r"shelve\w*", "sleep", "sleeps", "sleeping", "stand down",
    "stands down", "stand by", r"ditch\w*", "axe", r"unplug\w*", r"retire\w*", r"quarantine\w*",
    r"blacklist\w*", r"suspend\w*", r"withdraw\w*", "day off", "cut out", "rule out", "count out",
    "take out", "opt out", "make do without", "do without", "get by without", "go without",
    "manage without", "unavailable", "not available", "inactive", "deactivated", "disabled",
    "lock out", "locked out", "leave behind", r"stays? home", "at home", "knock off", "scrap",
    "turn off", "switch off", "standby", r"park\w*t", "geparkt", "parken", "abmelden", "abgemeldet",
    r"aussortier\w*", "rauswerfen", "rauswirf", "wirf raus", r"rausschmeiss\w*",
    r"schmeiss\w* raus", r"kick\w*", "wegfallen", "entfaellt", r"ausklammer\w*", r"klammer\w* aus",
    "abziehen", "abgezogen", "aussetzen", "setzt aus", "aussetzt", "pausiert", "schlafen",
    "schlaeft", r"kaltstell\w*", "kaltgestellt", r"blockier\w*", r"stillleg\w*", "stillgelegt",
    r"deaktivier\w*", "ausgeschaltet", "ausschalten", r"schalt\w* ab", "abgeschaltet", "abstellen",
    "abgestellt", r"abzieh\w*", "herausnehmen", "rausgenommen", "herausgenommen", "weggelassen",
    "ausgelassen", "ausgeschlossen", "ausgenommen", "ausgespart", "aussparen", "fernbleiben",
    "wegbleiben", "wegbleibt", "raushalten", "nicht verfuegbar", "ausser dienst", "off duty",
    "out of service", "out of action", "ausser betrieb", "im urlaub", "haende weg", "fern halten",
    "liegen lassen", "links liegen", "stehen lassen", "stehenlassen", "zu hause", "nix von",
    "nichts wissen", "absehen", "verzichten", "verzichtet", r"skip\w*", r"ignor\w*", r"exclud\w*",
    "drop", "dropping", "omit", "bench", "disable", "deactivate", "avoid", "remove", "without",
    "except", "besides", "excluding", "out", "off", "aside", "ALLBUT", "rest", "pause", "a break",
    "forget", "forget about", "spare", r"stop \w*", "in peace",
    r"(?:leave|leaving|lev|leaf|let) .*\b(?:alone|rest|sleep)",
    r"(?:leave|let) (?:\w+ )+be(?: please| now| TIME)*$",
    r"(?:leave|leaving|lev|leaf) (?:it|them|him|her)", "let it", "let them", "let him",
    "leave ROBOT", "leave it", "alone", r"left (?:alone|out|in peace|off|aside)", "ruhe gelassen",
    "nothing from", "nichts von", "zufrieden", "ruhe", "mit ausnahme", "with the exception",
    "exception", "disregard", r"(?:keep|stay) (?:\w+ )?away", "steer clear", "hold off", "lay off",
    "taboo", "tabu", "no go", r"finger (?:weg|von)", "heraushalten", "fernhalten", r"verschon\w*",
    "sit out", "out of bounds", "banned", "verboten", "gesperrt", "stay home", "daheim", "zuhause",
    "nicht dabei", r"entbehr\w*", "forbidden", "hinauslassen", "pass over", r"scheid\w* aus",
    "ohne", "ausser", "auslassen", "auslass", "lass aus", "weglassen", "weg", "raus", "aus",
    "rauslassen", r"ausschliess\w*", r"schliess\w* .*", "ausnehmen", r"ignorier\w*", r"verzicht\w*",
    r"uebergeh\w*", r"pausier\w*", "pausen", r"abschalt\w*", r"sperr\w*", "aussen vor", "draussen",
    "nichts hoeren", "vergiss", "vergessen", "meide", "vermeide", r"streich\w*", "rausnehmen",
    "auszulassen", "lahmlegen", "stilllegen", "beiseite", "fern", "ruhen",
)  # fmt: skip
UNUSED = any_of(
    "gebraucht", "needed", r"pester\w*", r"pinged", r"harass\w*", r"hassl\w*", r"nag\w*", "holen",
    "geholt", "hol", r"behellig\w*", "gerufen", "rufen", "ruft", "anfragt", r"anzufragen",
    "zu fragen", r"count\w* (?:\w+ ){0,3}in", "turn to", r"draft\w*", r"enlist\w*", "lean on",
    "go near", "rope in", "drag in", "mitmachen", "mitmacht", "teilnimmt", "mithelfen", "helfen",
    "help", "helps", "aushelfen", r"heranzu\w*", "anfunken", "angefunkt", "anpingen", "ping",
    "plan on", "schedule", "scheduled", "assign", "deploy", "pick", "choose", "select", "rely on",
    "einplanen", "eingeplant", "verplanen", r"beruecksichtig\w*", "einbinden", "eingebunden",
    "ansprechen", "angesprochen", r"heranzieh\w*", "herangezogen", r"hinzuzieh\w*", "zuziehen",
    r"beizieh\w*", r"auswaehl\w*", "waehlen", "waehl", "zaehlen auf", "verlassen", "bauen",
    "setzen", "hoeren", "anrufen", r"kontaktier\w*", "abfragen", "befragen", "einspannen",
    r"beanspruch\w*", "mitwirken", "mitspielen", r"mitzieh\w*", "ran", "dran", "drannehmen",
    "schicken", "losschicken", "zum einsatz", r"us(?:e|ed|ing)", "ask", "asked", "asking", "bother",
    "touch", "take", "include", "call", "query", "disturb", "count on", "consult", "consulted",
    "poll", "want", "need", "depend", "listen", "trust", "employ", "bothered", "disturbed", "let",
    "go", "fragt", r"bemueh\w*", "heranziehen", "hinzuziehen", "nutzen", "nutz", "nutze",
    "belaestigen", "ranlassen", "dabei", "involve", "request", "requests", "part", "participate",
    "rely", "contact", "gefragt", "gestoert", "benutzt", "genommen", "verwendet", "eingesetzt",
    "angefragt", "einbezogen", "queried", "contacted", "benutzen", "benutz", "benutze", "verwenden",
    "verwende", "nehmen", "nimm", "fragen", "frag", "frage", "einsetzen", "stoeren", "stoer",
    "mitnehmen", "anfragen", "brauchen", "brauch", "brauche", "brauchma", "einbeziehen",
    "beteiligen", "teilnehmen", "anfassen",
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
    r"(?:limit|restrict|confine|reduce)\w* .*\bto ROBOT", "stick with", "stick to", "keep to",
    "solely", "exclusively", "exclusive", "NOBODYBUT", "nobody else", "no one else", "none else",
    "noone else", "nothing else", "no other", "no others", "restrict", "nur", "ausschliesslich",
    "einzig", "lediglich", "sonst niemand", "sonst niemanden", "sonst keiner", "sonst keinen",
    "niemand sonst", "reicht", "reichen", "genuegt", "genuegen", "is enough", "are enough",
    "suffices", "suffice", "niemand anderes", "allein", "und sonst", "die anderen brauch",
    "limit yourself to ROBOT", "keine anderen", "keinen anderen",
)  # fmt: skip
JUST = any_of("bloss", "just", "merely", "purely")
FIRST = any_of(
    "ace", "ahead of the pack", "number one", "nummer eins", "first refusal", "first dibs",
    "first port of call", "first call", "first in line", "first in the queue", "first up",
    "best horse", "bestes pferd", "go to robot", r"in preference to",
    r"(?:shall|should|to|may|can|let ROBOT) lead", "take the lead", "takes the lead",
    "lead the way", "leads the way", r"vor (?:den )?anderen", "an erster stelle", "an die spitze",
    "an die erste stelle", "ans? erste[rs]?", "vornean", "voran", "vorneweg",
    r"sooner (?:have|use|ask|take)", r"(?:than|before) (?:any of )?the others?", "bevor ihr",
    "before you (?:bother|call|contact|query|turn to|ask|use|try|go to) (?:anyone|anybody|"
    "others?|the others?|any other)", "vorrangig", "vorzugsweise", "bevor du", "den anderen vor",
    "vor allen", "top pick", "first choice", "first pick", "top choice", "favourite", "favorite",
    "preferably", "over the others", "over all others", "over the rest", "before anybody",
    "vor den anderen", "erste adresse", r"favorit\w*", "als erste", "zu allererst", "zuallererst",
    "vorziehen", "vorgezogen", r"ziehe? vor", "den vortritt", "vortritt", "vorfahrt", "geht vor",
    "gehen vor", "first", r"prefer\w*", "rather", "priority", "prioriti[sz]e", r"favou?r\w*",
    "before everyone", "before everybody", "before the others", "before the rest", "before all",
    "before anyone", "start with", "at the top", "top of", "ideally", "begin with", "as first",
    "ahead of", "zuerst", r"bevorzug\w*", "vorrang", "vorzug", "am liebsten", "lieber",
    "erste wahl", "als erstes", "als ersten", r"priorisier\w*", "primarily", "zunaechst", "erster",
    "als erster", "wann immer moeglich", "go ahead of", "allen voran", "erste",
)  # fmt: skip
POSSIBLY = any_of(
    "lean on", "lean more on", "go to", "goto", "go for", "turn to", r"where(?:ver)? you can",
    r"where(?:ver)? possible", "mainly", "mostly", "chiefly", "above all", "vor allem",
    "as often as possible", "as much as possible", "whenever it works", "gern", "gerne",
    "for starters", "first of all", "wo es geht", "wo moeglich", "so oft es geht",
    "so oft wie moeglich", "erstmal", "hauptsaechlich", "vornehmlich", "in erster linie",
    "default to", "best bet", "if it works", "if it is possible", "if at all possible",
    "wenns geht", "wenns klappt", "wenns passt", "wenn es klappt", "wenn es passt",
    "sofern moeglich", "nach moeglichkeit", "where you can", "where possible", "wherever possible",
    "if possible", "if you can", "wenn moeglich", "moeglichst", "wenn es geht", "whenever possible",
    "whenever you can", "wann immer moeglich", "falls moeglich",
)  # fmt: skip
"""A preference of what is named, or politeness beside another cue."""
LAST = any_of(
    "last", "lastly", "zuletzt", "als letztes", "als letzter", "worst", "least",
)  # fmt: skip
OVER_OTHERS = re.compile(
    r"\b(?:over|before|ahead of|rather than|in preference to|sooner than|vor|lieber als|eher als) "
    r"(?:(?:all|any of|the|den|allen|everyone) ){0,2}"
    r"(?:rest|others?|anderen|else|uebrigen|everyone)\b"
)
CONTRAST = re.compile(
    r"\b(?:not|nicht) (?:the )?ROBOT (?:but|sondern)\b|\bsondern\b|\binstead of\b"
)
RATHER = re.compile(
    r"\b(?:lieber|rather|prefer\w*|eher|sooner|bevorzug\w*)\b.*\bROBOT\b.*"
    r"\b(?:als|than|over|statt) (?:(?:the|den|die|der|das) )?ROBOT\b|"
    r"^(?:please |bitte |and |und )?ROBOT (?:over|before|ahead of|vor) (?:(?:the|den|die|der|"
    r"das) )?ROBOT\b|\bROBOT (?:rather than|lieber als|eher als|in preference to) (?:(?:the|den|"
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
OTHERS = any_of(
    r"(?:everybody|everyone|anybody|anyone|nobody|no ?one) else", "(?:the )?remainder",
    "no other (?:robot|bot|unit)s?", r"sonst (?:keine[rn]?|niemand\w*)",
    r"(?:every|any) ?(?:one|body|thing|robot) else",
    r"(?:all |alle )?(?:the |die |den |der )?(?:others?|other (?:ones|robots|bots)|"
    r"remaining(?: ones| robots)?|anderen|uebrigen|restlichen)(?: robots?| robotern?| ones)?",
    r"(?:the|den|der|dem) rest", r"^(?:(?:and|dann|then|und) )*rest", "alle andern",
    "(?<! )rest(?= as| if| when| only)",
)  # fmt: skip
"""All robots but those that are named beside them."""
REST = re.compile(r"(?:then |and |dann |und )?(?:(?:the|der|die|den) )?(?:rest|others|anderen)\b")
"""Begins to speak of the others."""
BACKUP = any_of(
    "assist", "when need be", "if need be", "only when", "nur wenn", "fill in", "helfen aus",
    "fine as", "springen ein", "einspringen", "nur im notfall", r"back ?ups?", "reserve",
    "fallback", "second", "secondary", "if needed", "if necessary", "as needed", "as required",
    "when needed", "notfalls", "im notfall", "zur not", "ersatz", "danach", "afterwards", "later",
    "spaeter", "zweite wahl", "second choice", "hinten an", "hintenan", "erst danach", "nachrangig",
    "last", "zuletzt", "in reserve", "in an emergency", "as a spare", "bei bedarf", "nachher",
    "erst dann", "next", "after that",
)  # fmt: skip
"""Said of the others: who is named comes first."""
_ASK = r"(?:ask|us(?:e|ing)|query|poll|call|contact|tak(?:e|ing)|involve|include|consult|task)\w*"
_FRAG = (r"(?:(?:an|ab|be)?(?:g|ge)?frag|(?:be)?nutz|verwend|einsetz|eingesetzt|genommen|nehm|nimm|"
         r"ruf|geruf|mitmach|anfunk|angefunk|behellig|heranzieh|herangezogen|kontaktier|einbezieh|einbezogen|einplan|"
         r"eingeplant)\w*")  # fmt: skip
_PAST = (r"(?:asked|used|queried|polled|called|contacted|pinged|taken|involved|included|consulted|"
         r"tasked|bothered|disturbed|requested|needed|wanted|touched)")  # fmt: skip
_NONE = (r"(?:(?:no ?one|nobody)s?|none(?: of (?:them|the \w+))?|(?:no|not a|not one)(?: single)?"
         r" (?:robots?|bots?|units?|machines?))")  # fmt: skip
_KEINEN = (r"(?:kein|keine[nrm]?|koan\w*|niemand\w*)(?: (?:einzige[nrm]?|der|von den|von euch|"
r"von ihnen|"
           r"roboter\w*|mehr))*")  # fmt: skip
SUFFICES = any_of(
    "reicht", "reichen", "genuegt", "genuegen", "is enough", "are enough", "suffices", "suffice",
    "will do",
)  # fmt: skip
NOBODY = any_of(
    r"(?:no|zero) (?:queries|questions|requests?) (?:for|to) (?:all|robots|the robots)",
    r"^(?:please )?(?:no|zero) (?:robots?|bots?|units?)(?: at all| please| TIME)*$",
    r"(?:stop|quit|no) (?:ask|us|query|poll)ing (?:anyone|anybody|everyone|everybody|any \w+|"
    r"all)",
    rf"(?:dont|do not|never|mustnt|must not|shouldnt|should not|without)(?: \w+){{0,2}} {_ASK}"
    r"(?: \w+)? any(?: (?:single|of (?:them|the|our|these|those)|robots?|bots?|units?))+",
    rf"(?:dont|do not|never) (?:\w+ )?{_ASK} (?:anyone|anybody)",
    rf"no need to {_ASK} any(?: (?:single|of (?:them|the)|robots?|bots?|units?))*",
    rf"{_ASK} {_NONE}", rf"{_NONE}(?: TIME)?(?: at all)?(?: TIME)? {_PAST}",
    rf"(?:dont|do not|never) (?:\w+ )?{_ASK} (?:a|one) (?:single )?(?:robot|bot|unit|one)",
    rf"{_NONE}(?: at all)?(?: (?:should|shall|may|must|is to|are to|gets?|will))+(?: be)? "
    rf"{_PAST}", rf"{_NONE}(?: i mean {_NONE})? (?:gets?|is|are) {_PAST}",
    r"(?:leave|let) (?:all|every one of)(?: of)?(?: the| our)? (?:robots?|bots|units|them) "
    r"(?:alone|be|in peace|rest|undisturbed)",
    r"lass\w*(?: \w+)? alle(?: \w+)? (?:roboter\w*|robots|bots)(?: \w+)? (?:unbehelligt|in "
    r"ruhe|in frieden|stehen|aus|weg|raus|ruhen)",
    rf"(?:requests?|questions|quer(?:y|ies)) (?:to|from|for) {_NONE}",
    r"no (?:requests?|questions|queries) (?:to|for) any\w*(?: robots?| bots?| of them)?",
    rf"{_NONE} (?:is to|are to|is|are|may|shall|should|must|gets?|to) (?:be )?{_ASK}",
    rf"{_FRAG}(?: (?:bitte|jetzt|mir|ihr))* {_KEINEN}",
    rf"{_KEINEN}(?: \w+){{0,3}} (?:zu )?{_FRAG}",
)  # fmt: skip
"""No robot at all is to be asked."""
SOMEBODY = any_of(
    "else", "but", "except", "besides", "other than", "apart", "sonst", "ausser", r"ander\w+",
    "bis auf", "als", "more than", "mehr als", "PLACE", "CLASS",
)  # fmt: skip
"""Beside NOBODY they say that somebody is, or that it is said of a place only."""
IDLE = any_of(
    "lift a finger", r"(?:keinen|nicht einen|kein) finger", "have to do", "stehen", "stehenbleiben",
    "bleiben stehen", "feierabend", "haben frei", "ruhig", "join", "joins", "joins in", "join in",
    "hands off", "stay put", "stay out", "stand by", "stand down", "idle", "quiet", "silent",
    "keep quiet", "wait", "sleep", "rest", "warten", "schlafen", "still", "sit out", "keep out",
    "hold still", "go home", "pausieren", "schweigen", "nothing", "nichts", "stumm",
)  # fmt: skip
"""Said of the others: only who is named is asked."""
