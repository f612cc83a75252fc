"""Who may come in at an HTTP endpoint of the swarm: under which name, and with which token."""

from __future__ import annotations

import hmac
import re
from collections.abc import Collection, Mapping
from typing import Literal

from swarm.errors import SettingError
from swarm.http.hosts import Hosts, is_loopback
from swarm.secret_files import secret_of

# RFC 6750: what may stand behind "Bearer".
_TOKEN = re.compile(r"[A-Za-z0-9._~+/-]+=*")


def is_token(text: str) -> bool:
    """Whether a text can stand behind "Bearer"."""
    return _TOKEN.fullmatch(text) is not None


def check_token(setting: str, token: str) -> None:
    """Raises SettingError for a token that no header can carry; "" is none."""
    if token and not is_token(token):
        # The value is a secret.
        raise SettingError(f"{setting} is not valid; it must be letters, digits and . _ ~ + / -")


def token_of(setting: str, token: str, path: str) -> str:
    """The token of a setting, or the one in the file that `{setting}_FILE` names.

    Raises SettingError that never tells the token.
    """
    token = secret_of(setting, token, path, kind="token")
    check_token(f"{setting}_FILE = {path!r}" if path else setting, token)
    return token


class Bearer:
    """Lets in requests that show a token (RFC 6750), or all where there is none."""

    def __init__(self, token: str) -> None:
        self._expected = f"Bearer {token}".encode() if token else None

    def may(self, authorization: str) -> bool:
        """Whether a request with this `Authorization` header may come in."""
        if self._expected is None:
            return True
        scheme, _, shown = authorization.partition(" ")
        given = f"{scheme.capitalize()} {shown.strip()}".encode()
        return hmac.compare_digest(given, self._expected)


class Access:
    """The guard of an endpoint that programs ask: the name that was asked for, then the token."""

    def __init__(self, host: str, token: str, names: Collection[str] = ()) -> None:
        """`host` is where it listens, `names` what it may be asked for beside localhost and
        addresses: this host's own only, where it listens on loopback."""
        self.needs_token = bool(token)
        self._hosts = Hosts(names, loopback=is_loopback(host))
        self._bearer = Bearer(token)

    def refusal(
        self, headers: Mapping[str, str], *, without_token: bool = False
    ) -> Literal["", "name", "token"]:
        """What is wrong with a request; "" where it may come in. `headers` are found in small
        letters; `without_token`: this path shows nothing and does nothing."""
        if not self._hosts.may(headers.get("host", "")):
            return "name"
        if not without_token and not self._bearer.may(headers.get("authorization", "")):
            return "token"
        return ""
