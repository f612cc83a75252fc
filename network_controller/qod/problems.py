"""What a request can be refused with, in CAMARA's words."""

from __future__ import annotations

import msgspec

from swarm.errors import CoAdaptError


class ErrorInfo(msgspec.Struct, frozen=True, kw_only=True):
    """The body of every answer that is not a success."""

    status: int
    """The HTTP status once more."""
    code: str
    message: str


class Problem(CoAdaptError):
    """A request that is refused; it never leaves this package."""

    def __init__(self, status: int, code: str, message: str) -> None:
        super().__init__(message)
        self.info = ErrorInfo(status=status, code=code, message=message)


def invalid(message: str) -> Problem:
    """A request that does not have the form it should have."""
    return Problem(400, "INVALID_ARGUMENT", message)


def out_of_range(message: str) -> Problem:
    """A duration that the profile does not allow."""
    return Problem(400, "QUALITY_ON_DEMAND.DURATION_OUT_OF_RANGE", message)


def invalid_sink(message: str) -> Problem:
    """Events cannot be sent there."""
    return Problem(400, "INVALID_SINK", message)


def invalid_credential(message: str) -> Problem:
    """A kind of credential that this version of the API has no use for."""
    return Problem(400, "INVALID_CREDENTIAL", message)


def invalid_token(message: str) -> Problem:
    """A sink's token that cannot be used."""
    return Problem(400, "INVALID_TOKEN", message)


def another_name() -> Problem:
    """Asked under a name that is not this host's."""
    return Problem(
        403,
        "PERMISSION_DENIED",
        "this API answers under this host's own addresses, as localhost, and under the names that "
        "COADAPT_QOD_NAMES lists",
    )


def unauthenticated() -> Problem:
    """No bearer token, or the wrong one."""
    return Problem(
        401, "UNAUTHENTICATED", "the header Authorization must be 'Bearer' and the API's token"
    )


def not_found(message: str) -> Problem:
    """There is no such thing."""
    return Problem(404, "NOT_FOUND", message)


def unknown_device(message: str) -> Problem:
    """A well-formed identifier that nobody in the swarm has."""
    return Problem(404, "IDENTIFIER_NOT_FOUND", message)


def conflict(message: str) -> Problem:
    """There is a session for these flows already."""
    return Problem(409, "CONFLICT", message)


def not_extendable(status: str) -> Problem:
    """Only a session in force can be extended."""
    return Problem(
        409,
        "QUALITY_ON_DEMAND.SESSION_EXTENSION_NOT_ALLOWED",
        f"the session is {status}; only one that is AVAILABLE can be extended",
    )


def unsupported_media(content_type: str) -> Problem:
    """A body that is not declared as JSON."""
    return Problem(
        415,
        "UNSUPPORTED_MEDIA_TYPE",
        f"the body's Content-Type {content_type[:100]!r} must be 'application/json'",
    )


def missing_device() -> Problem:
    """The API's token stands for no device, so the request must name one."""
    return Problem(422, "MISSING_IDENTIFIER", "device is missing; name it by its ipv4Address")


def unsupported_device() -> Problem:
    """None of the identifiers is of a kind that is known here."""
    return Problem(
        422, "UNSUPPORTED_IDENTIFIER", "a device is known by its ipv4Address only; none is given"
    )


def not_applicable(message: str) -> Problem:
    """The device is known, but nothing can be promised to it."""
    return Problem(422, "SERVICE_NOT_APPLICABLE", message)


def too_many(message: str) -> Problem:
    """There is no room for more sessions."""
    return Problem(429, "QUOTA_EXCEEDED", message)


def unavailable(message: str) -> Problem:
    """The network cannot be asked now."""
    return Problem(503, "UNAVAILABLE", message)
