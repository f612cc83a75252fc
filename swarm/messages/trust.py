"""How a process on another machine comes by its renewed certificate."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarm.messages.base import Count, Message
from swarm.messages.choices import Operator

RoleName = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]
Pem = Annotated[str, msgspec.Meta(max_length=16_384)]


class CertificateRequest(Message, frozen=True, kw_only=True):
    """Asks the authority for the certificate that it last issued to who asks."""

    request: Count = 0
    role: RoleName
    """The common name of the certificate that the asker has."""
    operator: Operator = ""
    """Who asks: the router's rules say it, whatever stands here."""


class RenewedCertificate(Message, frozen=True, kw_only=True):
    """The certificate in PEM; it is for the key that the asker has. None of it is secret."""

    request: Count
    certificate: Pem
