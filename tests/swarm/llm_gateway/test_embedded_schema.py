"""From JSON schemas to grammars: what is refused, and what llama.cpp's grammar then allows."""

from __future__ import annotations

import functools
import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from llm_gateway.backends.llamacpp.constraint import Alphabet
from llm_gateway.backends.llamacpp.native import Native
from llm_gateway.backends.llamacpp.schema import MAX_SCHEMA_CHARS, SchemaError, grammar_of

pytestmark = pytest.mark.model

pytest_plugins = ("tests.support.embedded_fixtures",)


@functools.cache
def _alphabet(native: Native) -> Alphabet:
    return Alphabet.of(native)


def follows(native: Native, schema: dict[str, Any], text: str) -> bool:
    """Whether the grammar of a schema allows a text, and allows it to end there."""
    alphabet = _alphabet(native)
    letters = dict(zip(alphabet.text, alphabet.letters, strict=False))
    grammar = native.grammar(grammar_of(json.dumps(schema)))
    try:
        for letter in text:
            if not native.legal(grammar, alphabet.letters)[alphabet.text.index(letter)]:
                return False
            native.accept(grammar, int(letters[letter]))
        return bool(native.legal(grammar, alphabet.letters)[-1])
    finally:
        native.free(grammar)


SUBSET = {
    "type": "array",
    "items": {"enum": ["A", "B", "C"]},
    "uniqueItems": True,
    "contains": {"const": "B"},
    "minItems": 1,
    "maxItems": 2,
}
OPTIONAL = {
    "type": "object",
    "properties": {"a": {"const": 1}, "b": {"const": 2}, "c": {"const": 3}},
    "required": ["b"],
}


@pytest.mark.parametrize(
    ("schema", "good", "bad"),
    [
        ({"enum": ["x", 2, None]}, ['"x"', "2", "null"], ['"y"', "3", "true", ' "x"']),
        ({"type": "string", "maxLength": 3}, ['""', '"abc"', r'"\n\"a"'], ['"abcd"', "abc"]),
        ({"type": "string", "minLength": 2}, ['"ab"'], ['"a"', r'"\u0041b"']),
        ({"type": "integer"}, ["0", "-12"], ["01", "1.0", "1e3"]),
        ({"type": "number"}, ["0.5", "-3"], [".5", "1.", "1e9"]),
        ({"type": "boolean"}, ["true"], ["True", "1"]),
        (
            {"type": "array", "items": {"enum": ["A", "B"]}, "minItems": 1, "maxItems": 2},
            ['["A"]', '["B","B"]'],
            ["[]", '["A","B","A"]', '["C"]', '["A", "B"]'],
        ),
        ({"type": "array", "items": {"const": 1}, "maxItems": 0}, ["[]"], ["[1]"]),
        (
            {
                "type": "array",
                "prefixItems": [{"const": "E"}],
                "items": {"enum": ["A"]},
                "minItems": 1,
                "maxItems": 2,
            },
            ['["E"]', '["E","A"]'],
            ["[]", '["A"]', '["E","A","A"]'],
        ),
        (SUBSET, ['["B"]', '["A","B"]', '["B","C"]'], ["[]", '["A"]', '["B","A"]', '["B","B"]']),
        (
            OPTIONAL,
            ['{"b":2}', '{"a":1,"b":2,"c":3}', '{"b":2,"c":3}'],
            ["{}", '{"a":1}', '{"b":2,}'],
        ),
        ({"anyOf": [{"type": "null"}, {"const": 7}]}, ["null", "7"], ["8"]),
        ({"type": ["string", "null"], "maxLength": 1}, ["null", '"a"'], ['"ab"']),
        ({}, ['{"a":[1,{"b":null}]}', "[]"], ["{,}", ""]),
        (
            {"$ref": "#/$defs/t", "$defs": {"t": {"enum": ["q"]}}},
            ['"q"'],
            ['"r"'],
        ),
    ],
)
def test_a_grammar_allows_what_its_schema_does(
    native: Native,
    schema: dict[str, Any],
    good: list[str],
    bad: list[str],
) -> None:
    assert [text for text in good if not follows(native, schema, text)] == []
    assert [text for text in bad if follows(native, schema, text)] == []


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    low=st.integers(-1200, 1200),
    span=st.integers(0, 1500),
    near=st.integers(-3, 3),
    end=st.sampled_from([0, 1]),
)
def test_integers_keep_their_bounds(
    native: Native,
    low: int,
    span: int,
    near: int,
    end: int,
) -> None:
    value = low + end * span + near
    schema = {"type": "integer", "minimum": low, "maximum": low + span}
    assert follows(native, schema, str(value)) == (low <= value <= low + span)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    low=st.integers(-3000, 3000),
    span=st.integers(0, 4000),
    near=st.integers(-12, 12),
    end=st.sampled_from([0, 1]),
)
def test_numbers_keep_their_bounds_to_a_thousandth(
    native: Native,
    low: int,
    span: int,
    near: int,
    end: int,
) -> None:
    value = low + end * span + near
    schema = {"type": "number", "minimum": low / 1000, "maximum": (low + span) / 1000}
    text = f"{'-' if value < 0 else ''}{abs(value) // 1000}.{abs(value) % 1000:03d}"
    allowed = follows(native, schema, text)
    if allowed or value % 1000:
        assert allowed == (low <= value <= low + span)


@pytest.mark.parametrize(
    "schema",
    [
        "{",
        "[1]",
        '{"type":"string","pattern":"a"}',
        '{"type":"frog"}',
        '{"enum":[]}',
        '{"type":"integer","minimum":3,"maximum":2}',
        '{"type":"number","minimum":0.0001,"maximum":0.0002}',
        '{"type":"object","properties":{},"required":["a"]}',
        '{"type":"array","items":{"enum":["A"]},"uniqueItems":true,"minItems":2}',
        '{"type":"array","items":{"type":"string"},"uniqueItems":true}',
        '{"type":"array","minItems":9,"maxItems":2}',
        '{"type":"array","minItems":1000000000}',
        '{"type":"string","minLength":1000000000}',
        '{"$ref":"https://example.com/schema"}',
        '{"$ref":"#/$defs/none"}',
        '{"anyOf":' * 3000 + "1",
        " " * (MAX_SCHEMA_CHARS + 1),
    ],
)
def test_a_schema_that_cannot_be_enforced_is_refused(schema: str) -> None:
    with pytest.raises(SchemaError):
        grammar_of(schema)


def test_hostile_sizes_do_not_make_large_grammars() -> None:
    schema = '{"type":"array","items":{"type":"string","maxLength":999999999},"maxItems":99999999}'
    assert len(grammar_of(schema)) < 2000
