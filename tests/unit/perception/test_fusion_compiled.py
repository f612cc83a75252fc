"""Outlines, corrections and attention are the same with their loops in C and without."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perception.fusion import alignment, maps, outline
from perception.fusion.alignment import Field, correction, estimate
from perception.kernels import library
from swarm.errors import PayloadError
from tests.support.codec_scans import room_scan

pytestmark = pytest.mark.skipif(
    library.places() is None or library.network() is None,
    reason="perception was installed without a compiler",
)


def test_an_outline_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = np.concatenate([room_scan(32, 1024, seed=5), room_scan(8, 300, seed=6) * 4])
    edge = np.array([[44.999996, -44.999996, z] for z in (0.0, 1.0, 2.0, 3.0)], dtype=np.float32)
    for points in (cloud, np.concatenate([cloud, edge]), cloud[:0], cloud[:1]):
        ground = np.zeros(len(points), dtype=np.bool_)
        in_c = outline.outline(points, ground)
        with monkeypatch.context() as patch:
            patch.setattr(outline, "places", lambda: None)
            np.testing.assert_array_equal(outline.outline(points, ground), in_c)


@pytest.mark.parametrize("seed", range(3))
def test_a_field_and_that_of_more_places_are_the_same(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-60, 60, (3000, 2)).astype(np.float32)
    more = rng.uniform(-50, 50, (200, 2))
    in_c = Field.of(places).and_of(more)
    monkeypatch.setattr(alignment, "loops", lambda: None)
    in_numpy = Field.of(places).and_of(more)
    np.testing.assert_array_equal(in_c.likelihood, in_numpy.likelihood)
    np.testing.assert_array_equal(in_c.log, in_numpy.log)
    assert 0.0 < in_c.likelihood.mean() < 0.5


@pytest.mark.parametrize("seed", range(12))
def test_a_correction_is_the_same(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.concatenate([rng.uniform(-30, 30, (60, 2)), rng.uniform(-90, 90, (12, 2))])
    field = Field.of(places + rng.normal(0.0, 0.03, places.shape))
    sender = rng.uniform(-25, 25, 2)
    believed = places + np.array([0.5, -0.4])

    def found() -> np.ndarray | str:
        try:
            return correction(estimate(field, believed, sender).told(), sender)
        except PayloadError as error:
            return str(error)

    in_c = found()
    monkeypatch.setattr(alignment, "loops", lambda: None)
    in_numpy = found()
    if isinstance(in_c, str):
        assert in_c == in_numpy
    else:
        assert not isinstance(in_numpy, str)
        np.testing.assert_allclose(in_c, in_numpy, atol=1e-5)
        assert not np.array_equal(in_c, np.eye(4))


@pytest.mark.parametrize("count", [1, 2, 7])
def test_attention_is_the_same(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    torch.manual_seed(count)
    features = torch.rand(count, 32, 9, 5) * 3
    present = torch.rand(count, 9, 5) > 0.4
    present[0] = True
    with torch.inference_mode():
        in_c = maps.attend(features, present)
        monkeypatch.setattr(maps, "network", lambda: None)
        assert torch.allclose(in_c, maps.attend(features, present), atol=1e-5)


def test_attention_that_is_learned_through_keeps_its_gradient() -> None:
    features = torch.rand(2, 32, 3, 3, requires_grad=True)
    maps.attend(features, torch.ones(2, 3, 3, dtype=torch.bool)).sum().backward()
    assert features.grad is not None
    assert bool((features.grad != 0).any())
