"""Typed settings of one process, from a TOML file and the environment, checked at start.

A process declares a frozen msgspec Struct whose fields carry their limits
(`Annotated[float, msgspec.Meta(gt=0)]`). Field `period_s` is read from `COADAPT_PERIOD_S`, else
from `period_s` in the TOML file named by `COADAPT_CONFIG`, else its default holds.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec

from swarm.errors import SettingError

PREFIX = "COADAPT_"

Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]
Seconds = Annotated[float, msgspec.Meta(gt=0, le=3600)]
Secret = Annotated[str, msgspec.Meta(extra={"secret": True})]
"""A key or token: neither errors nor `shown` tell its value."""
Name = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}(?!\n)$")]

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
            raise SettingError(f"{variable} is not set; it must be {_allowed(field.type)}")
        else:
            continue
        try:
            values[field.name] = msgspec.convert(raw, field.type, strict=False)
        except msgspec.ValidationError as error:
            if field.type == Secret:
                raise SettingError(f"{variable} is not valid; it must be text") from None
            raise SettingError(
                f"{source} = {raw!r} is not valid: {error}; it must be {_allowed(field.type)}"
            ) from error
        # Comparisons with NaN are false, so it passes any limit.
        if isinstance(values[field.name], float) and not math.isfinite(values[field.name]):
            raise SettingError(f"{source} = {raw!r} is not valid; it must be a finite number")
    return kind(**values)


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


def _allowed(kind: Any) -> str:
    """The limits of a field in words, for the error message."""
    if get_origin(kind) is Annotated:
        base, *metas = get_args(kind)
        limits = [
            f"{name} {getattr(meta, name)}"
            for meta in metas
            for name in ("gt", "ge", "lt", "le", "pattern", "min_length", "max_length")
            if isinstance(meta, msgspec.Meta) and getattr(meta, name) is not None
        ]
        return " ".join([_allowed(base), *limits])
    arguments = get_args(kind)
    if arguments and all(isinstance(a, str) for a in arguments):
        return "one of " + ", ".join(arguments)
    if arguments:
        inner = [a for a in arguments if a is not Ellipsis]
        joined = " or ".join(_allowed(a) for a in inner)
        return joined if get_origin(kind) not in (tuple, list) else f"a list of {joined}"
    return "unset" if kind is type(None) else str(getattr(kind, "__name__", kind))
