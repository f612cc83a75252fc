"""Every error that CoAdapt Edge raises on purpose.

    CoAdaptError
    ├── SettingError          a setting is missing, malformed or out of range
    ├── MessageError          bytes from the network are not a valid message
    ├── KeyspaceError         a swarm name or robot id cannot be part of a key
    ├── IdentityError         a certificate, its key or its authority cannot be used
    ├── TransportError        the Zenoh session could not be opened or used
    │   └── RefusedError      a process answered a request with a refusal
    ├── WorldError            scans or ground truth cannot be read or simulated
    │   └── SilentError       a live sensor says nothing that is fresh
    ├── PerceptionError       a scan or payload cannot be processed
    │   ├── ScanError         the points are not a usable cloud
    │   └── PayloadError      an encoded payload is corrupt, truncated or of another version
    ├── DutyError             a robot is not on duty
    ├── DecisionError         a policy or a decision cannot be used
    ├── EvaluationError       an experiment's input or setting cannot be used
    ├── JournalError          a journal cannot be opened, read or written
    ├── NetworkError          a link cannot be shaped or read
    │   └── LinkGoneError     the link is not there (any more)
    ├── GatewayError          a request to a language model got no answer
    ├── RecordingError        a recording of a swarm cannot be written or compared
    ├── PictureError          a picture cannot be drawn or written
    └── DeployError           a runtime cannot be started, read or stopped
        └── PropertyError     a property of a swarm has a value that is not allowed

The command line prints the message and exits with 1; a message therefore names the thing, the
value and what is allowed.
"""

from __future__ import annotations

from typing import Literal

GatewayCode = Literal["expired", "busy", "too_large", "unavailable", "failed", "invalid"]
"""Past its deadline; no room in the queue; more than the model reads; no back end, or its breaker
is open; the back end failed; the model's answer does not follow the schema."""


class CoAdaptError(Exception):
    """Base of all errors raised on purpose."""

    code: str = ""
    """The kind of trouble, where an error names one; a `Refusal` carries it to who asked."""


class SettingError(CoAdaptError):
    """A setting is missing, malformed or out of range."""


class MessageError(CoAdaptError):
    """Bytes from the network are not a valid message."""


class KeyspaceError(CoAdaptError):
    """A swarm name or robot id cannot be part of a key."""


class IdentityError(CoAdaptError):
    """A certificate, its key or its authority cannot be used."""


class TransportError(CoAdaptError):
    """The Zenoh session could not be opened or used."""


class RefusedError(TransportError):
    """A process answered a request with a refusal."""

    def __init__(self, reason: str, key: str = "", code: str = "") -> None:
        """`reason` and `code` are the process' own; `key`, where it was asked, is in the message
        only."""
        super().__init__(f"{key} refused: {reason}" if key else reason)
        self.reason = reason
        self.code = code


class WorldError(CoAdaptError):
    """Scans or ground truth cannot be read or simulated."""


class SilentError(WorldError):
    """A live sensor says nothing that is fresh: what it said before is not how things are."""


class PerceptionError(CoAdaptError):
    """A scan or payload cannot be processed."""


class ScanError(PerceptionError):
    """The points are not a usable cloud."""


class PayloadError(PerceptionError):
    """An encoded payload is corrupt, truncated or of another version."""


class DutyError(CoAdaptError):
    """A robot is not on duty."""


class DecisionError(CoAdaptError):
    """A policy or a decision cannot be used."""


class EvaluationError(CoAdaptError):
    """An experiment's input or setting cannot be used."""


class JournalError(CoAdaptError):
    """A journal cannot be opened, read or written."""


class NetworkError(CoAdaptError):
    """A link cannot be shaped or read."""


class LinkGoneError(NetworkError):
    """The link is not there, or not any more."""


class GatewayError(CoAdaptError):
    """A request to a language model got no answer that can be used."""

    code: GatewayCode

    def __init__(self, code: GatewayCode, why: str) -> None:
        super().__init__(f"{code}: {why}")
        self.code = code
        self.why = why


class RecordingError(CoAdaptError):
    """A recording of a swarm cannot be written or compared."""


class PictureError(CoAdaptError):
    """A picture cannot be drawn or written."""


class DeployError(CoAdaptError):
    """A runtime cannot be started, read or stopped."""


class PropertyError(DeployError):
    """A property of a swarm has a value that is not allowed."""

    def __init__(self, name: str, value: object, shown: str, rule: str) -> None:
        """`shown`: the value as messages tell it; `rule`: what it must be, in words."""
        super().__init__(f"{name} = {shown} is not valid; it must be {rule}")
        self.name = name
        self.value = value
        self.rule = rule


def not_installed(package: str | None) -> str:
    """The text for a package that pyproject.toml has in an extra, and that is not there."""
    return (
        f"the package {package!r} is not installed; pip install 'coadapt-edge[swarm]' brings all "
        "that a swarm's processes and `coadapt` need"
    )
