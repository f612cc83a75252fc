"""JSON schemas of answers (Draft 2020-12), checked and compiled once each.

A schema comes from a client, and evaluating it must not stop the gateway: nothing is fetched,
regular expressions (which can take for ever) are refused, and the number of steps is bounded.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union

import jsonschema
import msgspec
from jsonschema import Draft202012Validator
from referencing import Registry

from swarm.errors import GatewayError

MAX_STEPS = 20_000
"""Of one evaluation: a third of a second. A decision takes about fifty."""
REMEMBERED = 256

_Type = Literal["null", "boolean", "object", "array", "number", "string", "integer"]
_Schema = Union["_Keywords", bool]
_Count = Annotated[int, msgspec.Meta(ge=0)]
_Number = int | float
_NAMES = {
    "if_": "if",
    "not_": "not",
    "else_": "else",
    "ref": "$ref",
    "dynamic_ref": "$dynamicRef",
    "defs": "$defs",
}


class _Keywords(msgspec.Struct, rename=lambda name: _NAMES.get(name)):
    """Keywords whose wrong use would only show when an answer is there; C code reads them."""

    type: _Type | list[_Type] = "object"
    enum: list[Any] = []
    required: list[str] = []
    properties: dict[str, _Schema] = {}
    additionalProperties: _Schema = True
    propertyNames: _Schema = True
    dependentSchemas: dict[str, _Schema] = {}
    dependentRequired: dict[str, list[str]] = {}
    minProperties: _Count = 0
    maxProperties: _Count = 0
    unevaluatedProperties: _Schema = True
    items: _Schema = True
    prefixItems: list[_Schema] = []
    contains: _Schema = True
    minContains: _Count = 0
    maxContains: _Count = 0
    unevaluatedItems: _Schema = True
    minItems: _Count = 0
    maxItems: _Count = 0
    uniqueItems: bool = False
    minLength: _Count = 0
    maxLength: _Count = 0
    minimum: _Number = 0
    maximum: _Number = 0
    exclusiveMinimum: _Number = 0
    exclusiveMaximum: _Number = 0
    multipleOf: Annotated[float, msgspec.Meta(gt=0)] = 1
    allOf: list[_Schema] = []
    anyOf: list[_Schema] = []
    oneOf: list[_Schema] = []
    not_: _Schema = True
    if_: _Schema = True
    then: _Schema = True
    else_: _Schema = True
    defs: dict[str, _Schema] = {}
    ref: str = "#"
    dynamic_ref: str = ""
    pattern: Any = None
    patternProperties: Any = None

    def __post_init__(self) -> None:
        if self.pattern is not None or self.patternProperties is not None:
            raise ValueError("regular expressions are not allowed")
        if not self.ref.startswith("#") or self.dynamic_ref:
            raise ValueError("only references within the schema are allowed")


_reader = msgspec.json.Decoder(_Keywords | bool)


class Schemas:
    """Evaluates values by schemas that are given as text."""

    def __init__(self) -> None:
        self._steps = 0
        self._compiled: OrderedDict[str, Any] = OrderedDict()
        keywords = {
            name: self._counted(check) for name, check in Draft202012Validator.VALIDATORS.items()
        }
        self._make = jsonschema.validators.extend(Draft202012Validator, keywords)

    def check(self, schema: str) -> None:
        """Raises GatewayError `invalid` that says what is wrong with a schema."""
        self._validator(schema)

    def fault(self, value: Any, schema: str) -> str:
        """What is wrong with a value, with the place in it; empty when it follows the schema.

        Raises GatewayError `invalid` for a schema that cannot be evaluated.
        """
        validator = self._validator(schema)
        self._steps = 0
        try:
            error = next(validator.iter_errors(value), None)
        except Exception as failure:
            # What a wrong schema raises is not specified: unknown references, endless ones, ...
            raise _refuse(f"{type(failure).__name__}: {failure}") from failure
        return "" if error is None else f"{error.json_path}: {error.message}"[:300]

    def _validator(self, schema: str) -> Any:
        found = self._compiled.get(schema)
        if found is not None:
            self._compiled.move_to_end(schema)
            return found
        try:
            _reader.decode(schema)
            made = self._make(msgspec.json.decode(schema), registry=Registry())
        except (msgspec.MsgspecError, RecursionError) as error:
            raise _refuse(str(error)) from error
        self._compiled[schema] = made
        if len(self._compiled) > REMEMBERED:
            self._compiled.popitem(last=False)
        return made

    def _counted(self, check: Any) -> Any:
        def counted(*arguments: Any) -> Iterator[jsonschema.ValidationError] | None:
            self._steps += 1
            if self._steps > MAX_STEPS:
                raise OverflowError(f"more than {MAX_STEPS} steps")
            found: Iterator[jsonschema.ValidationError] | None = check(*arguments)
            return found

        return counted


def _refuse(why: str) -> GatewayError:
    return GatewayError("invalid", f"the request's JSON schema cannot be used: {why[:300]}")
