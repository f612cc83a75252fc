"""Where the world frame lies on the Earth."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarm.errors import SettingError

_A, _E2 = 6_378_137.0, 6.694379990141e-3
"""WGS 84: the ellipsoid's major half axis, metres, and its eccentricity squared."""
MOST_LATITUDE = 85.0
_FORM = "LATITUDE,LONGITUDE in degrees (WGS 84), like 48.8566,2.3522"


@dataclass(frozen=True, slots=True)
class Anchor:
    """The place of the world's origin, whose x points east and y north.

    Distances are those in the plane that touches the ellipsoid there: a millimetre off at 100 m,
    a decimetre at a kilometre.
    """

    latitude: float
    longitude: float

    def degrees(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude of a place in metres."""
        north, east = self._scales()
        return (
            self.latitude + math.degrees(y / north),
            self.longitude + math.degrees(x / east),
        )

    def metres(self, latitude: float, longitude: float) -> tuple[float, float]:
        """x and y of a place in degrees."""
        north, east = self._scales()
        turned = math.remainder(longitude - self.longitude, 360.0)
        return (math.radians(turned) * east, math.radians(latitude - self.latitude) * north)

    def _scales(self) -> tuple[float, float]:
        """Metres a radian to the north, and to the east (radii of curvature, Torge: Geodesy)."""
        phi = math.radians(self.latitude)
        root = math.sqrt(1.0 - _E2 * math.sin(phi) ** 2)
        return (_A * (1.0 - _E2) / root**3, _A / root * math.cos(phi))


def parse_anchor(text: str) -> Anchor:
    """The anchor as it is written. Raises SettingError that says what is allowed."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError as error:
        raise SettingError(f"origin {text!r} is not valid; it must be {_FORM}") from error
    if not (abs(latitude) <= MOST_LATITUDE and abs(longitude) <= 180.0):
        raise SettingError(
            f"origin {text!r} is not valid; latitudes go to {MOST_LATITUDE:.0f} degrees, "
            "longitudes to 180"
        )
    return Anchor(latitude, longitude)
