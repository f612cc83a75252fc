"""Keys and tokens that a file holds, so that no environment and no list of processes shows them."""

from __future__ import annotations

from pathlib import Path

from swarm.errors import SettingError

MAX_BYTES = 65_536


def secret_of(setting: str, value: str, path: str, *, kind: str) -> str:
    """The value of a setting, or the text of the file that `{setting}_FILE` names, without white
    space around it. `kind` is what it is, in a word.

    Raises SettingError that never tells the secret.
    """
    if not path:
        return value
    name = f"{setting}_FILE"
    if value:
        raise SettingError(f"{setting} and {name} are both set; set one of them")
    try:
        with Path(path).open("rb") as file:
            text = file.read(MAX_BYTES).decode("ascii").strip()
    except OSError as error:
        raise SettingError(
            f"{name} = {path!r} cannot be read: {error.strerror}; it must be a file that holds the "
            f"{kind}"
        ) from None
    except UnicodeDecodeError:
        text = ""
    if not text:
        raise SettingError(f"{name} = {path!r} holds no {kind}; it must be ASCII text")
    return text
