"""Words for people to whom, or in whose name, somebody speaks, and who are not looked for."""

from __future__ import annotations

CALLED = frozenset(
    """colleague colleagues folks folk guys kollege kollegen kollegin kolleginnen lad lads
    leut leute mate mates maenner mann people men""".split()
)
"""Behind a last comma, or before a first one, they are spoken to: "tern first, lads"."""
TITLES = frozenset(
    """arzt aerztin colleague doctor doktor frau guard herr kollege kollegin mister nurse
    officer pfleger porter schwester sister waerter""".split()
)
"""Before a name they belong to it: "Schwester Monika"."""
ENDS = frozenset({"folks", "guys", "lads"})
"""At the end of a sentence they are spoken to even without a comma: "eyes on the ramp folks"."""
SPEAKS = frozenset(
    "insists meint reckons sagt says tells thinks told verlangt wants wuenscht".split()
)
"""Behind somebody they say that it is he who wishes: "the guard wants the gate watched"."""
