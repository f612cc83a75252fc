"""The Scene Abstraction Module: a scan as a structured description.

`describe` names the objects, `visible_range` how far free ground is seen around the robot,
`segment` and `ground_mask` give the points behind both, `to_array` the form that travels.
"""

from perception.scene.arrays import COLUMNS, from_array, to_array
from perception.scene.description import (
    METHODS,
    MIN_SIDE_M,
    OWN_BODY_M,
    describe,
    ground_mask,
    segment,
)
from perception.scene.segmentation import Segmentation
from perception.scene.visibility import visible_range

__all__ = [
    "COLUMNS",
    "METHODS",
    "MIN_SIDE_M",
    "OWN_BODY_M",
    "Segmentation",
    "describe",
    "from_array",
    "ground_mask",
    "segment",
    "to_array",
    "visible_range",
]
