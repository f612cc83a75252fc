"""Words that change nothing of what a clause wishes of a robot.

A robot is left out, or the only one, without a question only where every word of the clause is a
cue or one of these: "leave R3 out" is plain, "R3 pretends to be out" is not.
"""

from __future__ import annotations

import re
from functools import lru_cache

from llm_gateway.wishes.cues.spelling import KNOWN, PATTERNS, SPELLING

_PLAIN = frozenset(
    """darfste moege moegen pruefer solle sollste ersuchen bitten spot place area part corner
    stelle ort bereich ecke
    gegend koennts habts seids wollts sollts yall sir maam love guys bittschoen lassts tuts
    nehmts fragts lassens nehmens grosses isch immer erschte roster rota pool sit sits sitting
    faellt faellst fallen weiter machen arbeiten auskommen u ur ya em s m limits
    limit order bounds reach hands fingers answer answers speak talk join contribute respond
    reply cooperate feel feels well mine ours yours further till til line side sight mind
    planen plane plant machs gehts machts hats ists ma mer net bissl bisschen soviel antworten
    antwortet reden melden mitreden zaehlt gilt gelten stehen steht liegen liegt a an the this
    that these those it its he she him her them they his their i im id ill ive we wed weve us
    our you your youre me my of to in on at by be been being is are am do does and or nor as
    so then also too just still please pls plz kindly thanks thank thx cheers mate ok okay
    alright right hi hey hello there here now today ahead all whole entirely completely
    totally altogether really simply better best rather maybe would could can may might must
    should shall will lets let want wants wish need needs needed like prefer have has had get
    gets got give gives make makes made keep keeps kept put puts leave stay stays remain
    remains go goes going come take taken set sure certain both each every one ones other
    others else more anymore any anything some such same only use used using swarm fleet team
    robot robots bot bots unit units guy machine machines thing things number numbers nr no
    again game loop picture mix group list round plan plans job work service duty action for
    with from until about up down off over but eh uh um er hm yeah yes folks everyone
    everybody anybody anyone nobody temporarily permanently immediately straight away moment
    time least damn bloody goddamn fucking whatever happens matter what question questions
    request requests observations observation report reports decision decisions planning
    sensing perception asked allowed permitted supposed ought meant available useful able out
    gonna gotta wanna ein eine einen einem einer eines der die das den dem des dies diese
    diesen dieser dieses es sie ihn ihm ihr ihre ihren ihrem ihnen ich wir uns mir mich du
    euch man wer was mein unser zu zum zur auf von vom bei beim mit fuer und oder auch noch
    nur mal bitte danke merci gern gerne halt eben doch ja dann jetzt nun heute gleich sofort
    erst erstmal einmal ab ganz voellig komplett einfach lieber besser wirklich gar bis aus
    werden wird werde wurde worden sein ist sind bin bist seid waere soll sollen sollt sollte
    sollten solls kann kannst koennen koennt koennte koennten darf duerfen muss muessen muesst
    wollen wollt wuerde wuerden moechte moechten mag hab habe haben hat hast lass lasse lasst
    lassen laesst bleibt bleib bleibe bleiben bleibts macht mach tut tun gibt geben nimmt
    nehmt nehmen fragt fragen benutzt verwendet nutzt gelassen gemacht mehr jeder jede jeden
    alle alles allen anderen andere anderer uebrigen schwarm flotte roboter robotern ding
    kiste nummer hier da dort daran dabei dafuer davon damit herum einsatz spiel runde liste
    planung frage anfrage anfragen beobachtungen daten vorerst vorlaeufig einstweilen derzeit
    gerade momentan augenblick zeit lange solange unbedingt definitiv sowieso servus moin
    hallo kannste koennste ned nicht nich wenn geht moeglich leute jungs ihrs deshalb daher
    darum deswegen therefore hence thus possible okey plus aufs ins sowie selbst allein
    ausnahmslos koenntet wuerdet moegt moechtet haettet waert waeren muesste muessten duerfte
    duerften taetet taet taets fiele wohl ob geholfen gebt lieb always treat rate mark mean
    grateful glad happy pleased obliged appreciate delighted thankful lovely nice great kind
    grand swell dankbar froh recht schoen nett prima super toll klasse fein acknowledge roger
    copy repeat confirm understood verstanden gell ne bitteschoen own know way knows kennt
    kennen haett haetten quite share shares tried try tries versuchen versucht probieren probiert
    regen sollst koenntest wuerdest moechtest solltest darfst willst magst trusted helper carry
    proceed continue crack manage cope weitermachen
    helpers assist einzige einzigen einzig einspannen duerft goennt goennen tho though account
    yer old oben sprich dazu zieht nimm greift zurueck greifen hol holt holen kommt kommen dran
    wholly purely strictly instead first last anstatt stattdessen mitnehmen ueberhaupt rein
    raus rauf runter period dot full""".split()
)
_DEFECTS = frozenset(
    """broken faulty defective damaged dirty blind tired slow hot wet scratch scratched dent
    dented cracked loose bent worn old stuck lost sick ill repair repairs maintenance workshop
    lidar radar camera cameras lens sensor sensors wheel wheels battery flat empty fault error
    errors problem problems trouble issue issues drifting drifts drift noisy noise fails
    failing failed charging charger busy elsewhere kaputt defekt beschaedigt verschmutzt
    dreckig muede langsam nass heiss verbogen verkratzt kratzer delle schlag knacks macke
    abbekommen schaden reparatur wartung werkstatt kamera linse sensoren rad raeder akku
    batterie leer fehler stoerung probleme krank spinnt zickt hakt klemmt laedt ladestation
    verliert rauscht beschaeftigt hin hinueber""".split()
)
"""What is told of a robot that is left out."""
_WHY = re.compile(
    r"\b(?:drop|get|keep|kick|leave|pull|take|throw)\w* (?:\w+ ){0,2}ROBOT out of (?:(?:our|the|"
    r"this) )?\w+|\b(?:because of|due to|owing to|for|fuer|wegen|aufgrund|zwecks|zur|zum)"
    r"(?! (?:\w+ ){0,2}(?:while|bit|moment|shift|weile|zeit|schicht|now)\b)(?: [a-z]+){1,4}"
)
"""Tells a reason, or for what a robot is needed elsewhere."""
_THING = re.compile(
    r"^(?:and |und )?(?=([a-z]{4,})(?: [a-z]+){0,2} (?:is|are|gets?|matters?|counts?|goes|go|geht|"
    r"gehen|ist|sind|haben|hat|needs?|deserves?|zaehl\w+|brauch\w+|verdien\w+)\b)|"
    r"(?:\b(?:bitte|please|the|our|to|at|on|in|near|around|den|die|das|der|dem|im|am|beim|bei|"
    r"zum|zur|auf|uns\w*|for|fuer|rate|rank|weigh|mark|of) )(?:[a-z]{1,2} - )?(?=([a-z]{3,})\b)"
)
"""Names something: the word behind an article, or before "is"."""
_BARE = frozenset(
    """ROBOT TIME pls plz more not no nicht nix nichts kein keine keinen keiner keinesfalls
    mit with the den der die please bitte thanks danke aber doch jedoch bloss blos nur ja but
    und and auf fall under circumstances in any case never nie niemals net ned nich also auch
    too thx lieber weder neither nor noch garnicht better besser hey ok okay today jetzt now
    jedenfalls mehr gar ueberhaupt whatsoever at all anything""".split()
)

_LEAST = 3
"""Letters of a name."""


def strange(text: str, *, ailing: bool = False) -> bool:
    """Whether a clause has words that no list knows, besides a reason.

    `ailing`: it may tell what is wrong with a robot.
    """
    left = [word for word in _WHY.sub(" ", text).split() if not known(word)]
    return not (ailing and set(left) <= _DEFECTS) if left else False


def unknown_thing(text: str) -> bool:
    """Whether a clause speaks of something by a word that no list knows: "the helicopters"."""
    return any(not known(found[1] or found[2]) for found in _THING.finditer(text))


def unknown_robots(text: str) -> bool:
    """Whether a clause speaks of robots by a word that no list knows: "no blue robots"."""
    found = re.search(r"\b([a-z]{3,}) (?:- )?(?:bots?|robots?|robotern?|units?)\b", text)
    return found is not None and not known(found[1])


def bare(text: str) -> bool:
    """Whether a clause says no to what it names, and nothing else: "not R3", "nix mit R3"."""
    return set(text.split()) <= _BARE


def unfamiliar(word: str) -> bool:
    """Whether a word may be a name that no list knows."""
    return word.isalpha() and len(word) >= _LEAST and not known(word)


@lru_cache(maxsize=4096)
def known(word: str) -> bool:
    """Whether a list knows a word as a cue, or as one that changes nothing."""
    if not word.isalpha() or not word.islower():
        return not word.isdigit()
    if word in _PLAIN or word in _BARE or word in KNOWN or word in SPELLING:
        return True
    return any(cue.fullmatch(word) for cue in PATTERNS)
