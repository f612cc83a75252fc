"""Typed settings of one process, from a TOML file and the environment, checked at start.

A process declares a frozen msgspec Struct whose fields carry their limits
(`Annotated[float, msgspec.Meta(gt=0)]`). Field `period_s` is read from `COADAPT_PERIOD_S`, else
from `period_s` in the TOML file named by `COADAPT_CONFIG`, else its default holds.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import msgspec

from swarm.errors import SettingError

PREFIX = "COADAPT_"

NAME_RULE = "1 to 32 letters, digits, '_' or '-'"

Port = Annotated[int, msgspec.Meta(ge=0, le=65535, description="a port")]
Seconds = Annotated[float, msgspec.Meta(gt=0, le=3600, description="seconds")]
Secret = Annotated[str, msgspec.Meta(extra={"secret": True})]
"""A key or token: neither errors nor `shown` tell its value."""
Name = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$", description=NAME_RULE)]

_BASES = {
    float: "a number", int: "a whole number", str: "text", bool: "true or false", NoneType: "unset"
}  # fmt: skip
_RANGES = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_FORMS = {"pattern": "like", "min_length": "of length >=", "max_length": "of length <="}

S = TypeVar("S", bound=msgspec.Struct)


def load(kind: type[S], environment: Mapping[str, str] | None = None) -> S:
    """The settings of the given kind, every field checked.

    Raises SettingError that names the variable or key, its value and what is allowed.
    """
    environment = os.environ if environment is None else environment
    file_values = _read_toml(environment.get(PREFIX + "CONFIG"))
    values: dict[str, Any] = {}
    for field in msgspec.structs.fields(kind):
        variable = PREFIX + field.name.upper()
        if variable in environment:
            source, raw = variable, _split(environment[variable], field.type)
        elif field.name in file_values:
            source, raw = field.name, file_values[field.name]
        elif field.required:
            raise SettingError(f"{variable} is not set; it must be {allowed(field.type)}")
        else:
            continue
        try:
            values[field.name] = msgspec.convert(raw, field.type, strict=False)
        except msgspec.ValidationError as error:
            if field.type == Secret:
                raise SettingError(f"{variable} is not valid; it must be text") from None
            raise SettingError(
                f"{source} = {_without_user(raw)!r} is not valid: {error}; "
                f"it must be {allowed(field.type)}"
            ) from error
        # Comparisons with NaN are false, so it passes any limit.
        if isinstance(values[field.name], float) and not math.isfinite(values[field.name]):
            raise SettingError(f"{source} = {raw!r} is not valid; it must be a finite number")
    return kind(**values)


def _without_user(raw: Any) -> Any:
    """A value as it may be shown: a URL may hold a password."""
    return re.sub(r"(?<=://)[^/\s]*@", "...@", raw) if isinstance(raw, str) else raw


def allowed(kind: Any) -> str:
    """What a field of that type may be, in words: its limits, behind its `description` if it has
    one."""
    if get_origin(kind) is Annotated:
        base, *others = get_args(kind)
        metas = [meta for meta in others if isinstance(meta, msgspec.Meta)]
        named = next((meta.description for meta in metas if meta.description), None)
        words = _RANGES if named else _RANGES | _FORMS
        limits = [
            f"{word} {getattr(meta, name)}"
            for meta in metas
            for name, word in words.items()
            if getattr(meta, name) is not None
        ]
        return f"{named or allowed(base)} {' and '.join(limits)}".strip()
    arguments = [argument for argument in get_args(kind) if argument is not Ellipsis]
    if get_origin(kind) in (tuple, list):
        return f"a list of {allowed(arguments[0])}"
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(str, arguments))}"
    if arguments:
        return " or ".join(map(allowed, arguments))
    return _BASES.get(kind, str(getattr(kind, "__name__", kind)))


def shown(settings: msgspec.Struct) -> str:
    """The settings as text, without secrets: what a class that has some says of itself."""
    values = (
        (field.name, field.type == Secret, getattr(settings, field.name))
        for field in msgspec.structs.fields(settings)
    )
    told = (f"{n}={'***' if secret and value else repr(value)}" for n, secret, value in values)
    return f"{type(settings).__name__}({', '.join(told)})"


def _read_toml(path: str | None) -> dict[str, Any]:
    if not path:
        return {}
    try:
        return tomllib.loads(Path(path).read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SettingError(f"{PREFIX}CONFIG = {path!r} cannot be read: {error}") from error


def _split(raw: str, kind: Any) -> Any:
    """A comma-separated variable becomes a list where the field is a sequence."""
    if get_origin(kind) is Annotated:
        return _split(raw, get_args(kind)[0])
    if get_origin(kind) in (tuple, list):
        return [part.strip() for part in raw.split(",") if part.strip()]
    return raw
