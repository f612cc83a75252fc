"""What an operator may name of how an ego decides."""

from __future__ import annotations

from typing import Annotated

import msgspec

Operator = Annotated[str, msgspec.Meta(max_length=64)]
PolicyName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
QMin = Annotated[float, msgspec.Meta(ge=0, le=1)]
