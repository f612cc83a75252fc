"""Collective perception as the standard has it: which objects a station tells, and what is held of
what others told (ETSI TS 103 324 V2.1.1)."""
