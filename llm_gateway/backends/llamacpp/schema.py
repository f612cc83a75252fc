"""From a JSON schema to a grammar (GBNF, llama.cpp's) of the answers that follow it.

The grammar may be stricter than the schema, never looser: properties come in the schema's order,
without white space, and the members of an array without duplicates in the order of its `enum`.
A keyword that it could not enforce is refused rather than ignored.
"""

from __future__ import annotations

import json
import math
from typing import Any

from llm_gateway.backends.llamacpp import ranges

MAX_SCHEMA_CHARS = 50_000
MAX_TEXT = 1000
"""Characters of one string, at most."""
MAX_ITEMS = 256

_COMMA = ' "," '
_CHAR = r'char ::= [^"\\\x7F\x00-\x1F] | "\\" ["\\/bfnrt]'
_BUILTIN = {
    "string": f'"\\"" char{{0,{MAX_TEXT}}} "\\""',
    "integer": '"-"? ("0" | [1-9] [0-9]{0,14})',
    "number": '"-"? ("0" | [1-9] [0-9]{0,14}) ("." [0-9]{1,6})?',
    "boolean": '"true" | "false"',
    "null": '"null"',
    "object": '"{" (string ":" value ("," string ":" value)*)? "}"',
    "array": '"[" (value ("," value)*)? "]"',
    "value": "object | array | string | number | boolean | null",
}
_SAID = {"title", "description", "default", "examples", "$schema", "$id", "$comment", "$defs"}
"""Keywords that restrict nothing."""
_KNOWN = {
    "object": {"properties", "required", "additionalProperties"},
    "array": {"items", "prefixItems", "minItems", "maxItems", "uniqueItems", "contains"},
    "string": {"minLength", "maxLength"},
    "integer": {"minimum", "maximum"},
    "number": {"minimum", "maximum"},
}


class SchemaError(ValueError):
    """A schema is not valid JSON, or asks for what no grammar here can enforce."""


def grammar_of(schema: str) -> str:
    """The grammar, with `root` as its start. Raises SchemaError."""
    if len(schema) > MAX_SCHEMA_CHARS:
        raise SchemaError(f"{len(schema)} characters, at most {MAX_SCHEMA_CHARS} are read")
    try:
        parsed = json.loads(schema)
        writer = _Writer(parsed)
        root = writer.rule(parsed)
    except SchemaError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise SchemaError(f"malformed: {error}") from error
    except RecursionError as error:
        raise SchemaError("nested too deeply") from error
    lines = [f"root ::= {root}", _CHAR]
    lines += [f"{name} ::= {body}" for name, body in {**_BUILTIN, **writer.rules}.items()]
    return "\n".join(lines)


def _literal(text: str) -> str:
    """A GBNF literal for a text."""
    return json.dumps(text)


def _json(value: object) -> str:
    return _literal(json.dumps(value, ensure_ascii=True, separators=(",", ":")))


class _Writer:
    """Turns parts of one schema into rules, and names those that are used again."""

    def __init__(self, schema: Any) -> None:
        self.rules: dict[str, str] = {}
        self._schema = schema
        self._named: dict[str, str] = {}

    def rule(self, schema: Any) -> str:
        """The body of a rule; alternatives are not in parentheses."""
        if schema is True or schema == {}:
            return "value"
        if not isinstance(schema, dict):
            raise SchemaError(f"{schema!r} is not a schema")
        if "$ref" in schema:
            return self._reference(schema["$ref"])
        if "const" in schema:
            return _json(schema["const"])
        if "enum" in schema:
            return self._one_of([_json(value) for value in schema["enum"]])
        for word in ("anyOf", "oneOf"):
            if word in schema:
                return self._one_of([self.rule(option) for option in schema[word]])
        kind = schema.get("type") or ("object" if "properties" in schema else None)
        if isinstance(kind, list):
            return self._one_of([self.rule({**schema, "type": one}) for one in kind])
        if kind not in _BUILTIN or kind == "value":
            raise SchemaError(f"type {kind!r} is not one of {', '.join(_KNOWN)}, boolean, null")
        if unknown := schema.keys() - {"type"} - _KNOWN.get(kind, set()) - _SAID:
            known = set().union(*_KNOWN.values())
            if unknown - known:
                raise SchemaError(f"cannot enforce {', '.join(sorted(unknown - known))}")
        return str(getattr(self, f"_{kind}", lambda _: kind)(schema))

    def _one_of(self, options: list[str]) -> str:
        if not options:
            raise SchemaError("nothing is allowed: an empty list of options")
        return " | ".join(dict.fromkeys(options))

    def _name(self, body: str) -> str:
        """A name for a rule with this body."""
        if body not in self._named:
            self._named[body] = name = f"r{len(self._named)}"
            self.rules[name] = body
        return self._named[body]

    def _reference(self, ref: str) -> str:
        if ref not in self._named:
            if not ref.startswith("#/"):
                raise SchemaError(f"$ref {ref!r} does not begin with #/")
            self._named[ref] = name = f"r{len(self._named)}"
            target = self._schema
            for part in ref[2:].split("/"):
                target = target[part]
            self.rules[name] = self.rule(target)
        return self._named[ref]

    def _object(self, schema: dict[str, Any]) -> str:
        properties = schema.get("properties")
        if properties is None:
            if schema.get("required"):
                raise SchemaError("required names properties that are not described")
            return "object"
        required = set(schema.get("required", ()))
        if missing := required - properties.keys():
            raise SchemaError(f"required names undescribed {', '.join(sorted(missing))}")
        # From the last to the first: what may follow when nothing, or something, stands before.
        first, later = '"}"', '"}"'
        for name, value in reversed(properties.items()):
            member = f"{_literal(json.dumps(name) + ':')} {self._name(self.rule(value))}"
            if name in required:
                first, later = f"{member} {later}", f'"," {member} {later}'
            else:
                rest, skipped = self._name(later), self._name(first)
                first = f"({member} {rest} | {skipped})"
                later = f'("," {member})? {rest}'
        return f'"{{" {first}'

    def _array(self, schema: dict[str, Any]) -> str:
        least = int(schema.get("minItems", 0))
        most = min(int(schema.get("maxItems", MAX_ITEMS)), MAX_ITEMS)
        if least > most:
            raise SchemaError(f"between {least} and {most} items: no array is so long")
        head = [self.rule(item) for item in schema.get("prefixItems", ())][:most]
        items = schema.get("items", True)
        if items is False:
            most = len(head)
            items = True
        if schema.get("uniqueItems") or "contains" in schema:
            return self._subset(schema, items, head, least, most)
        item = self._name(self.rule(items))
        names = [self._name(body) for body in head]
        left = most - len(names)
        tail = f' ("," {item}){{{max(0, least - len(names))},{left}}}' if left else ""
        if names:
            if least < len(names):
                raise SchemaError(f"prefixItems of {len(names)} need minItems {len(names)}")
            return f'"[" {_COMMA.join(names)}{tail} "]"'
        if most == 0:
            return '"[]"'
        more = f'{item} ("," {item}){{{max(0, least - 1)},{most - 1}}}'
        return f'"[" {more} "]"' if least else f'"[" ({more})? "]"'

    def _subset(
        self, schema: dict[str, Any], items: Any, head: list[str], least: int, most: int
    ) -> str:
        """Members of `items.enum` in its order, none twice, `contains.const` among them."""
        if not isinstance(items, dict) or "enum" not in items or head:
            raise SchemaError("uniqueItems and contains need items with an enum, no prefixItems")
        values = list(dict.fromkeys(_json(value) for value in items["enum"]))
        wanted = set()
        if "contains" in schema:
            wanted = {_json(schema["contains"]["const"])}
        if wanted - set(values) or least > len(values) or (wanted and most < 1):
            raise SchemaError("no array holds so many different items, or what it must contain")
        most = min(most, len(values))
        # after[n]: what may follow when n members stand and those before `value` are decided.
        after: dict[int, str | None] = {n: '"]"' if n >= least else None for n in range(most + 1)}
        for value in reversed(values):
            now: dict[int, str | None] = {}
            for n in range(most + 1):
                taken = after[n + 1] if n < most else None
                comma = '"," ' if n else ""
                take = f"{comma}{value} {taken}" if taken else None
                skip = None if value in wanted else after[n]
                options = [option for option in (take, skip) if option]
                now[n] = self._name(" | ".join(options)) if options else None
            after = now
        if after[0] is None:
            raise SchemaError("no array can follow these rules")
        return f'"[" {after[0]}'

    def _string(self, schema: dict[str, Any]) -> str:
        least = int(schema.get("minLength", 0))
        most = min(int(schema.get("maxLength", MAX_TEXT)), MAX_TEXT)
        if least > most:
            raise SchemaError(f"between {least} and {most} characters: no text is so long")
        return f'"\\"" char{{{least},{most}}} "\\""'

    def _integer(self, schema: dict[str, Any]) -> str:
        if not schema.keys() & {"minimum", "maximum"}:
            return "integer"
        low, high = self._bounds(schema)
        return ranges.integers(math.ceil(low), math.floor(high))

    def _number(self, schema: dict[str, Any]) -> str:
        if not schema.keys() & {"minimum", "maximum"}:
            return "number"
        return ranges.decimals(*self._bounds(schema))

    def _bounds(self, schema: dict[str, Any]) -> tuple[float, float]:
        limit = 10**12
        return schema.get("minimum", -limit), schema.get("maximum", limit)
