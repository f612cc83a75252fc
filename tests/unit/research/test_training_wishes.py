"""Generated wishes, and the small training loop that learns them."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch

from llm_gateway.model import Reply
from llm_gateway.wishes.account import settle
from llm_gateway.wishes.compose import compose
from llm_gateway.wishes.form import parse
from llm_gateway.wishes.reading import ROLES, VERDICTS
from research.evaluation.wishes.score import score
from research.training.wishes import gguf_file
from research.training.wishes.batches import Lesson, batches
from research.training.wishes.cases import WISHES, cases
from research.training.wishes.export import export, restore
from research.training.wishes.grammar import LANGUAGES, WEIGHTS, phrases, templates
from research.training.wishes.llama import Llama, Shape
from research.training.wishes.lora import adapt, adapted
from research.training.wishes.samples import samples
from research.training.wishes.written import written

SMALL = Shape(
    blocks=2, width=32, heads=4, key_heads=2, hidden=48, vocabulary=40, rotary_base=1e4,
    epsilon=1e-5,
)  # fmt: skip


def test_equal_seeds_give_equal_wishes_and_splits_differ() -> None:
    def some(seed: int) -> list[tuple[str, str]]:
        return [(s.prompt, s.answer) for s in itertools.islice(samples(seed), 30)]

    assert some(3) == some(3)
    assert some(3) != some(4)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", [*WEIGHTS, "strange", "nothing"])
def test_validation_keeps_templates_of_its_own(language: str, name: str) -> None:
    words = phrases(language)
    learned, kept = (set(templates(words, name, split)) for split in ("train", "validate"))
    assert learned
    assert kept
    assert not learned & kept


def test_answers_follow_the_form_and_use_every_role() -> None:
    roles: Counter[str] = Counter()
    verdicts: Counter[str] = Counter()
    for sample in itertools.islice(samples(1), 600):
        reading = parse(sample.text, Reply(sample.answer))
        assert reading.roles == sample.reading.roles
        roles.update(reading.roles)
        verdicts[reading.verdict] += 1
    assert set(roles) == {role for allowed in ROLES.values() for role in allowed}
    assert min(verdicts.values()) > 30


def test_wishes_of_people_are_read_and_answered_as_they_are_meant() -> None:
    learnt = cases(WISHES.with_name("wishes-learnt.jsonl"))
    found = list(written(learnt))
    assert len(found) > 0.8 * len(learnt)
    assert {s.reading.verdict for s in found} == {*VERDICTS}
    for sample in found:
        assert parse(sample.text, Reply(sample.answer)).roles == sample.reading.roles
    exact = [
        score(case, compose(s.text, settle(s.text, s.reading), s.now)).wrong == ()
        for case in learnt
        for s in written([case])
        if case.kind == "wish"
    ]
    assert sum(exact) > 0.9 * len(exact)


def test_an_adapter_is_gone_on_from(tmp_path: Path) -> None:
    torch.manual_seed(0)
    first, second = Llama(SMALL), Llama(SMALL)
    for parameter in adapt(first):
        torch.nn.init.normal_(parameter)
    adapt(second)
    export(first, tmp_path / "a.gguf", name="test")
    restore(second, tmp_path / "a.gguf")
    for (_, one), (_, other) in zip(adapted(first), adapted(second), strict=True):
        torch.testing.assert_close(one.a, other.a, atol=2e-3, rtol=2e-3)
        torch.testing.assert_close(one.b, other.b, atol=2e-3, rtol=2e-3)


def test_gguf_files_keep_what_is_written(tmp_path: Path) -> None:
    path = tmp_path / "x.gguf"
    tensor = np.arange(15, dtype=np.float16).reshape(3, 5)
    gguf_file.write(path, {"general.type": "adapter", "alpha": 2.0}, {"a": tensor, "b": tensor.T})
    facts, tensors = gguf_file.read(path)
    assert facts == {"general.type": "adapter", "alpha": 2.0}
    np.testing.assert_array_equal(tensors["a"], tensor)
    np.testing.assert_array_equal(tensors["b"], tensor.T)


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.gguf"
    path.write_bytes(b"PK\x03\x04 not a model at all")
    with pytest.raises(ValueError, match="no GGUF file"):
        gguf_file.read(path)


def test_an_adapter_changes_nothing_before_it_has_learned() -> None:
    torch.manual_seed(0)
    model = Llama(SMALL)
    tokens = torch.randint(0, 40, (2, 7))
    wanted = torch.ones_like(tokens, dtype=torch.bool)
    before = model(tokens, wanted)
    adapt(model)
    torch.testing.assert_close(model(tokens, wanted), before)


def test_what_stands_behind_changes_nothing() -> None:
    torch.manual_seed(0)
    model = Llama(SMALL)
    tokens = torch.randint(0, 40, (1, 8))
    wanted = torch.zeros_like(tokens, dtype=torch.bool)
    wanted[0, 4] = True
    before = model(tokens, wanted)
    tokens[0, 5:] = 0
    torch.testing.assert_close(model(tokens, wanted), before)


def test_only_the_adapter_learns_and_it_is_exported(tmp_path: Path) -> None:
    torch.manual_seed(0)
    model = Llama(SMALL)
    trained = adapt(model)
    assert {id(p) for p in model.parameters() if p.requires_grad} == {id(p) for p in trained}
    lessons = [Lesson((1, 2, 3, 4 + n, 9 + n), 3) for n in range(4)]
    optimizer = torch.optim.Adam(trained, lr=0.02)
    losses = []
    for _ in range(40):
        for batch in batches(lessons, 4, random.Random(0)):
            logits = model(batch.tokens, batch.learned)
            following = torch.roll(batch.tokens, -1, dims=1)[batch.learned]
            loss = torch.nn.functional.cross_entropy(logits, following)
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            optimizer.step()
            losses.append(loss.item())
    assert losses[-1] < losses[0] / 2
    export(model, tmp_path / "adapter.gguf", name="test")
    facts, tensors = gguf_file.read(tmp_path / "adapter.gguf")
    assert facts["adapter.type"] == "lora"
    layers = dict(adapted(model))
    assert len(tensors) == 2 * len(layers)
    layer = layers["blk.1.ffn_down"]
    np.testing.assert_allclose(
        tensors["blk.1.ffn_down.weight.lora_b"], layer.b.detach().numpy(), atol=1e-3
    )
