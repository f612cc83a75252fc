"""The ASN.1 modules of Collective Perception Messages: brought, checked and compiled.

They are ETSI's (BSD-3-Clause, https://forge.etsi.org/rep/ITS/asn1), as the project vanetza carries
them: TS 103 324 V2.1.1 with the common data dictionary TS 102 894-2 V2.4.1.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

from swarm.errors import SettingError
from swarm.files import write_whole
from worlds.sample import data_home

COMMIT = "9811d58e1059ba67bd3ce594739a8b966734ead3"
URL = f"https://raw.githubusercontent.com/riebl/vanetza/{COMMIT}/asn1/release2"
_CPM = "TS103324v211/CPM-"
FILES: Mapping[str, str] = {
    f"{_CPM}OriginatingStationContainers.asn": (
        "87e85c56cf9c11f4834934a962705c0389290b3bac12404eb2422c75ee53245d"
    ),
    f"{_CPM}PDU-Descriptions.asn": (
        "3aaf7ec411316040e12cb7379e4526e28108dc7deba94dc3855f5ed761ef1316"
    ),
    f"{_CPM}PerceivedObjectContainer.asn": (
        "f3f9eaad244a8ed3334e3f41500815bf5dab871b0ca608152c225b5fb33bcc5b"
    ),
    f"{_CPM}PerceptionRegionContainer.asn": (
        "d178edbf06798f4ab74f059f88f51973921f25f24c8f159382c3e59baa6af31a"
    ),
    f"{_CPM}SensorInformationContainer.asn": (
        "953ec841c2280ec66bf4979145c74184e28d2d9b0fda4206cb015211d3084df0"
    ),
    "TS102894-2v241-CDD.asn": "b114fc6803190502b28dcc27d61aa92a9d92c3dbce1258b8e33cace797201c55",
}
"""Below URL, with the SHA-256 of each."""
TIMEOUT_S = 30.0
MOST_BYTES = 1 << 20

# asn1tools takes a union of values for its first one; what counts for PER is the span of all.
# And it has a type that is constrained again keep the extension marker, which X.680 (50.8) takes
# away, as asn1c does, with which the stacks vanetza and etsi_its_messages are made.
_SAID_OTHERWISE = (
    ("TrafficParticipantType (unknown|passengerCar..tram|agricultural)", "INTEGER (0..14)"),
    (
        "ConstraintWrappedCpmContainers ::= WrappedCpmContainers",
        "ConstraintWrappedCpmContainers ::= SEQUENCE SIZE(1..8) OF WrappedCpmContainer",
    ),
)


def folder() -> Path:
    """Where the modules are put."""
    return data_home() / "etsi-cpm"


def are_there() -> bool:
    """Whether all modules are in their place, unchanged."""
    return all(_sound(folder() / Path(name).name, digest) for name, digest in FILES.items())


def bring(source: str = URL) -> Path:
    """Puts the modules into `folder()` and returns it; what is there already stays.

    source: a URL below which they are, `https:` or `file:`. Raises SettingError where one cannot be
    had or is another one than expected; then none is put in place.
    """
    brought = {}
    for name, digest in FILES.items():
        if _sound(folder() / Path(name).name, digest):
            continue
        try:
            # Through the environment's proxy, as what is fetched from the Internet must be.
            with urlopen(f"{source}/{name}", timeout=TIMEOUT_S) as answer:
                data = answer.read(MOST_BYTES)
        except (URLError, OSError, ValueError) as error:
            raise SettingError(
                f"{name} cannot be had from {source}: {error}. Where there is no network, bring "
                f"the folder asn1/release2 of https://github.com/riebl/vanetza at {COMMIT[:12]} "
                "here, and name it with --source file:///..."
            ) from error
        if hashlib.sha256(data).hexdigest() != digest:
            raise SettingError(f"{source}/{name} is another file than expected: SHA-256 {digest}")
        brought[folder() / Path(name).name] = data
    folder().mkdir(parents=True, exist_ok=True)
    for path, data in brought.items():
        write_whole(path, data)
    return folder()


@cache
def compiled() -> Any:
    """The modules, as asn1tools encodes and decodes them in UPER.

    Raises SettingError where the package or the modules are missing.
    """
    try:
        import asn1tools
    except ModuleNotFoundError as error:
        raise SettingError(
            "the package asn1tools is missing: run `make setup`, or pip install "
            "'coadapt-edge[etsi]'"
        ) from error
    if not are_there():
        raise SettingError(
            f"the ASN.1 modules of ETSI are not in {folder()}: run `coadapt cpm modules`"
        )
    texts = [(folder() / Path(name).name).read_text("latin-1") for name in FILES]
    return asn1tools.compile_string("\n".join(said_otherwise(texts)), "uper")


def said_otherwise(texts: list[str]) -> list[str]:
    """The modules, with what asn1tools would take for something else in words that it takes right.

    Raises SettingError where that is not in them exactly once.
    """
    whole = "\0".join(texts)
    for old, new in _SAID_OTHERWISE:
        if whole.count(old) != 1:
            raise SettingError(
                f"{old!r} is {whole.count(old)} times in the modules; expected: once"
            )
        whole = whole.replace(old, new)
    return whole.split("\0")


def _sound(path: Path, digest: str) -> bool:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() == digest
    except OSError:
        return False
