"""JSON out of a model's words, and schemas that must not hold the gateway up."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm_gateway.answers import MAX_CHARS, AnswerError, extract
from llm_gateway.schemas import Schemas
from swarm.errors import GatewayError

SCHEMA = json.dumps(
    {
        "type": "object",
        "properties": {
            "participants": {"type": "array", "items": {"enum": ["R1", "R2"]}, "minItems": 1},
            "reason": {"type": "string"},
        },
        "required": ["participants"],
        "additionalProperties": False,
    }
)
GOOD = '{"participants": ["R1"]}'
ANYTHING = "true"


@pytest.mark.parametrize(
    "words",
    [
        GOOD,
        f"  {GOOD}\n",
        f"```json\n{GOOD}\n```",
        f"Sure, here you are:\n```\n{GOOD}\n```\nIs there anything else?",
        f'<think>Perhaps {{"participants": ["R2"]}}? No.</think>{GOOD}',
        f'{{"participants": ["R2"]}} it was, I thought.</think>\n\n{GOOD}',
        f"<thinking>\n{{[</thinking>```json\n{GOOD}```",
        f"[1] says {{R1}} and {{}}: {GOOD} {{",
        f"{GOOD} {GOOD}",
    ],
)
def test_an_answer_is_found_in_what_stands_around_it(words: str) -> None:
    assert extract(words, SCHEMA, Schemas()) == '{"participants":["R1"]}'


def test_words_in_an_answer_are_no_reasoning_around_it() -> None:
    words = '{"participants": ["R1"], "reason": "</think> <think> ```json {"}'
    assert json.loads(extract(words, SCHEMA, Schemas())) == json.loads(words)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("", "empty"),
        (" \n", "empty"),
        ("R1 and R2, early.", "no_json"),
        (f"<think>{GOOD}", "no_json"),
        ('{"participants": ["R1"', "malformed"),
        ('{"participants": [', "malformed"),
        ("[" * 50_000, "malformed"),
        ('{"participants": ["R7"]}', "schema"),
        ('{"participants": []}', "schema"),
        ('{"participants": ["R1"], "price": 1}', "schema"),
        ("[1]", "schema"),
        ("x" * (MAX_CHARS + 1), "too_long"),
    ],
)
def test_what_is_no_answer_is_refused_with_its_kind(words: str, reason: str) -> None:
    with pytest.raises(AnswerError) as caught:
        extract(words, SCHEMA, Schemas())
    assert caught.value.reason == reason


@pytest.mark.parametrize(
    "words", ["NaN", "-Infinity", "1e999", '{"a": NaN}', '"\\ud800"', "[1e400]", "9" * 5000]
)
def test_what_json_cannot_carry_is_refused(words: str) -> None:
    with pytest.raises(AnswerError):
        extract(words, ANYTHING, Schemas())


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=12,
)


@given(values.filter(lambda value: isinstance(value, dict | list)), st.text("ab \n.`", max_size=9))
def test_any_json_survives_chatter(value: object, chatter: str) -> None:
    words = f"{chatter}{json.dumps(value, indent=1)}{chatter}"
    assert json.loads(extract(words, ANYTHING, Schemas())) == value


@given(st.text(alphabet='{}[]",:a1\\<think>/ \n', max_size=60))
def test_any_words_are_an_answer_or_refused(words: str) -> None:
    try:
        text = extract(words, ANYTHING, Schemas())
    except AnswerError:
        return
    json.loads(text)


def doubling(levels: int) -> str:
    """A small schema that takes 2 ** levels steps."""
    defs: dict[str, object] = {
        f"d{i}": {"allOf": [{"$ref": f"#/$defs/d{i + 1}"}] * 2} for i in range(levels)
    }
    return json.dumps({"$defs": defs | {f"d{levels}": {}}, "$ref": "#/$defs/d0"})


@pytest.mark.parametrize(
    ("schema", "told"),
    [
        ('{"type": "objekt"}', "Invalid enum value 'objekt' - at `$.type`"),
        ('{"required": "a"}', "at `$.required`"),
        ('{"items": {"minimum": "1"}}', "at `$.items.minimum`"),
        ("not json", "malformed"),
        ("[" * 40_000, "Expected"),
        ('{"anyOf": [{"pattern": "(a+)+$"}]}', "regular expressions are not allowed"),
        ('{"patternProperties": {"(a+)+$": {}}}', "regular expressions are not allowed"),
        ('{"$ref": "http://127.0.0.1:1/schema"}', "only references within the schema"),
        ('{"$ref": "file:///etc/passwd"}', "only references within the schema"),
        ('{"$ref": "#/nowhere"}', "nowhere"),
        ('{"$ref": "#"}', "recursion"),
        (doubling(40), "more than 20000 steps"),
    ],
)
def test_a_schema_that_cannot_be_used_is_named(schema: str, told: str) -> None:
    with pytest.raises(GatewayError, match="invalid: the request's JSON schema") as caught:
        extract(GOOD, schema, Schemas())
    assert told in str(caught.value)
    assert len(str(caught.value)) < 400


def test_references_within_a_schema_and_properties_named_like_keywords_work() -> None:
    schema = json.dumps(
        {
            "$defs": {"id": {"enum": ["R1"]}},
            "properties": {"pattern": {"$ref": "#/$defs/id"}, "items": {"type": "integer"}},
        }
    )
    schemas = Schemas()
    assert schemas.fault({"pattern": "R1", "items": 3}, schema) == ""
    assert schemas.fault({"pattern": "R2"}, schema) == "$.pattern: 'R2' is not one of ['R1']"
