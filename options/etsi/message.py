"""Collective Perception Messages as values, in UPER: TS 103 324 V2.1.1.

Of a station that moves: the management container, the container of an originating vehicle, and that
of perceived objects. Positions are metres east, north and up of the station's reference position;
angles are radians from east, anticlockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from options.etsi.modules import compiled
from swarm.errors import PayloadError

MESSAGE_ID = 14
PROTOCOL_VERSION = 2
VEHICLE, OBJECTS = 1, 5
"""Containers, by their numbers."""
MAX_OBJECTS = 255
MAX_BYTES = 65_536
EPOCH_MS = 1_072_915_200_000
"""2004-01-01 UTC in milliseconds of Unix, where the time of ITS begins."""
LEAP_MS = 5_000
"""Leap seconds since then: ITS time counts them, Unix time does not (none since 2017)."""

_UNKNOWN_COORDINATE, _UNKNOWN_SPEED, _UNKNOWN_ANGLE, _UNKNOWN_SIDE = 4096, 127, 127, 32
"""Confidences that are not told."""
_CLASSES: dict[str, tuple[str, Any]] = {
    "car": ("vehicleSubClass", 5),
    "truck": ("vehicleSubClass", 8),
    "forklift": ("vehicleSubClass", 10),
    "person": ("vruSubClass", ("pedestrian", 1)),
}
_OTHER = ("otherSubClass", 1)
"""A single object of no class of traffic, as a robot is."""


@dataclass(frozen=True, slots=True)
class Told:
    """One object."""

    id: int
    label: str
    """car, truck, forklift or person; anything else is told, and read, as `other`."""
    center: tuple[float, float, float]
    """Metres east, north and up of the reference position; told in centimetres up to 1,310 m."""
    size: tuple[float, float, float]
    """Length, width, height; told in tenths of a metre up to 25.4 m."""
    heading: float
    velocity: tuple[float, float]
    """East and north, m/s; told in cm/s."""
    score: float
    """The chance that it is there."""
    age_s: float = 0.0
    """From when it was seen until the message's time."""


@dataclass(frozen=True, slots=True)
class Cpm:
    """What one station tells."""

    station: int
    unix_ms: int
    latitude: float
    longitude: float
    """Degrees, WGS 84; told in 1e-7 degrees."""
    orientation: float
    """The station's own."""
    objects: tuple[Told, ...]


def encode(message: Cpm) -> bytes:
    """The message in UPER. What lies beyond a field's limits is told as the limit.

    Raises SettingError as `modules.compiled` does, PayloadError for more than MAX_OBJECTS objects.
    """
    if len(message.objects) > MAX_OBJECTS:
        raise PayloadError(f"{len(message.objects)} objects in one CPM; allowed: {MAX_OBJECTS}")
    asn = compiled()
    north = (math.tau / 4 - message.orientation) % math.tau
    vehicle = {"orientationAngle": {"value": _tenths(north), "confidence": _UNKNOWN_ANGLE}}
    objects = {
        "numberOfPerceivedObjects": len(message.objects),
        "perceivedObjects": [_object(one) for one in message.objects],
    }
    ellipse = {
        "semiMajorConfidence": 4095,
        "semiMinorConfidence": 4095,
        "semiMajorOrientation": 3601,
    }
    position = {
        "latitude": round(message.latitude * 1e7),
        "longitude": round(message.longitude * 1e7),
        "positionConfidenceEllipse": ellipse,
        "altitude": {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"},
    }
    time = message.unix_ms - EPOCH_MS + LEAP_MS
    parts = (
        (VEHICLE, asn.encode("OriginatingVehicleContainer", vehicle)),
        (OBJECTS, asn.encode("PerceivedObjectContainer", objects)),
    )
    whole = {
        "header": {
            "protocolVersion": PROTOCOL_VERSION,
            "messageId": MESSAGE_ID,
            "stationId": message.station,
        },
        "payload": {
            "managementContainer": {"referenceTime": time, "referencePosition": position},
            "cpmContainers": [{"containerId": n, "containerData": raw} for n, raw in parts],
        },
    }
    encoded: bytes = asn.encode("CollectivePerceptionMessage", whole)
    return encoded


def decode(data: bytes) -> Cpm:
    """The message; what it tells beyond `Cpm` is left out.

    Raises PayloadError for bytes that are no CPM of this version, SettingError as
    `modules.compiled` does.
    """
    if len(data) > MAX_BYTES:
        raise PayloadError(f"a CPM of {len(data)} bytes; allowed: {MAX_BYTES}")
    asn = compiled()
    try:
        whole = asn.decode("CollectivePerceptionMessage", data)
        header, payload = whole["header"], whole["payload"]
        kind = header["protocolVersion"], header["messageId"]
        if kind != (PROTOCOL_VERSION, MESSAGE_ID):
            raise PayloadError(
                f"message {kind[1]} of version {kind[0]} is no CPM; it must be message "
                f"{MESSAGE_ID} of version {PROTOCOL_VERSION}"
            )
        parts = {one["containerId"]: one["containerData"] for one in payload["cpmContainers"]}
        orientation = 0.0
        if VEHICLE in parts:
            angle = asn.decode("OriginatingVehicleContainer", parts[VEHICLE])["orientationAngle"]
            orientation = (math.tau / 4 - math.radians(angle["value"] / 10)) % math.tau
        found = []
        if OBJECTS in parts:
            inner = asn.decode("PerceivedObjectContainer", parts[OBJECTS])
            found = [_told(one) for one in inner["perceivedObjects"]]
        management = payload["managementContainer"]
        place = management["referencePosition"]
    except PayloadError:
        raise
    except Exception as error:
        # asn1tools and bitstruct raise errors of many kinds over bytes that are none.
        raise PayloadError(f"{len(data)} bytes are no CPM: {error}") from error
    return Cpm(
        station=header["stationId"],
        unix_ms=management["referenceTime"] + EPOCH_MS - LEAP_MS,
        latitude=place["latitude"] / 1e7,
        longitude=place["longitude"] / 1e7,
        orientation=orientation,
        objects=tuple(found),
    )


def _object(one: Told) -> dict[str, Any]:
    x, y, z = (
        {"value": _within(100 * value, -131_072, 131_071), "confidence": _UNKNOWN_COORDINATE}
        for value in one.center
    )
    vx, vy = (
        {"value": _within(100 * value, -16_382, 16_382), "confidence": _UNKNOWN_SPEED}
        for value in one.velocity
    )
    long, wide, high = (
        {"value": _within(10 * side, 1, 254), "confidence": _UNKNOWN_SIDE} for side in one.size
    )
    kind = _CLASSES.get(one.label, _OTHER)
    return {
        "objectId": one.id % 65_536,
        "measurementDeltaTime": _within(-1000 * one.age_s, -2048, 2047),
        "position": {"xCoordinate": x, "yCoordinate": y, "zCoordinate": z},
        "velocity": ("cartesianVelocity", {"xVelocity": vx, "yVelocity": vy}),
        "angles": {"zAngle": {"value": _tenths(one.heading), "confidence": _UNKNOWN_ANGLE}},
        "objectDimensionZ": high,
        "objectDimensionY": wide,
        "objectDimensionX": long,
        "objectPerceptionQuality": _within(15 * one.score, 0, 15),
        "classification": [{"objectClass": kind, "confidence": _within(100 * one.score, 1, 100)}],
    }


def _told(one: dict[str, Any]) -> Told:
    place = one["position"]
    quality = one.get("objectPerceptionQuality")
    zed = place.get("zCoordinate", {"value": 0})
    angle = one.get("angles", {}).get("zAngle", {"value": 3601})["value"]
    # A side that is not told, or beyond what can be, is told as nothing.
    size = tuple(
        side["value"] / 10 if (side := one.get(f"objectDimension{axis}")) else 0.0 for axis in "XYZ"
    )
    return Told(
        id=one.get("objectId", 0),
        label=_label(one.get("classification", ())),
        center=(
            place["xCoordinate"]["value"] / 100,
            place["yCoordinate"]["value"] / 100,
            zed["value"] / 100,
        ),
        size=(size[0], size[1], size[2]),
        heading=math.radians(angle / 10) % math.tau if angle <= 3600 else 0.0,
        velocity=_velocity(one.get("velocity")),
        score=1.0 if quality is None else quality / 15,
        age_s=-one["measurementDeltaTime"] / 1000,
    )


def _velocity(told: Any) -> tuple[float, float]:
    """East and north, m/s; 0 where it is not told."""
    if told is None:
        return (0.0, 0.0)
    form, values = told
    if form == "cartesianVelocity":
        return (values["xVelocity"]["value"] / 100, values["yVelocity"]["value"] / 100)
    speed = values["velocityMagnitude"]["speedValue"]
    angle = math.radians(values["velocityDirection"]["value"] / 10)
    if speed > 16_382:
        return (0.0, 0.0)
    return (speed / 100 * math.cos(angle), speed / 100 * math.sin(angle))


def _label(classes: Any) -> str:
    """The project's name of the surest class."""
    if not classes:
        return "other"
    kind, value = max(classes, key=lambda one: int(one["confidence"]) % 101)["objectClass"]
    if kind == "vruSubClass" and value[0] == "pedestrian":
        return "person"
    names = {told: label for label, told in _CLASSES.items() if told[0] == "vehicleSubClass"}
    return names.get((kind, value), "car" if kind == "vehicleSubClass" else "other")


def _tenths(angle: float) -> int:
    """An angle in tenths of a degree, 0 to 3599."""
    return round(math.degrees(angle) * 10) % 3600


def _within(value: float, least: int, most: int) -> int:
    return min(most, max(least, round(value)))
