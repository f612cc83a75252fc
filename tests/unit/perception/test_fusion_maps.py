"""Fusing feature maps cell by cell, whatever the maps show."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from perception.fusion.feature_fusion import Fuse
from perception.fusion.maps import attend, strongest

BOTH = pytest.mark.parametrize("fuse", [attend, strongest])


def maps(robots: int = 4, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """Maps (robots, 32, 5, 6) and which cells are there: all of the ego's, half of the others'."""
    generator = torch.Generator().manual_seed(seed)
    present = torch.rand(robots, 5, 6, generator=generator) < 0.5
    present[0] = True
    return torch.rand(robots, 32, 5, 6, generator=generator), present


@BOTH
def test_the_ego_alone_keeps_its_map(fuse: Fuse) -> None:
    features, present = maps()
    assert torch.equal(fuse(features[:1], present[:1]), features[0])
    nobody = torch.zeros_like(present)
    nobody[0] = True
    assert torch.allclose(fuse(features, nobody), features[0], atol=1e-6)


@BOTH
@given(seed=st.integers(0, 10_000), robots=st.integers(2, 6))
def test_what_was_not_sent_does_not_matter(fuse: Fuse, seed: int, robots: int) -> None:
    features, present = maps(robots, seed)
    other = features.clone()
    other[~present[:, None].expand_as(other)] = 1.0
    nothing = features * present[:, None]
    fused = fuse(features, present)
    assert torch.allclose(fused, fuse(other, present), atol=1e-6)
    assert torch.allclose(fused, fuse(nothing, present), atol=1e-6)


@BOTH
@given(seed=st.integers(0, 10_000), robots=st.integers(3, 6))
def test_the_order_of_helpers_does_not_matter(fuse: Fuse, seed: int, robots: int) -> None:
    features, present = maps(robots, seed)
    order = torch.randperm(robots - 1, generator=torch.Generator().manual_seed(seed)) + 1
    order = torch.cat([torch.zeros(1, dtype=torch.int64), order])
    assert torch.allclose(fuse(features, present), fuse(features[order], present[order]), atol=1e-6)


def test_strongest_is_the_largest_that_was_sent() -> None:
    features, present = maps()
    fused = strongest(features, present)
    for row in range(5):
        for column in range(6):
            sent = features[present[:, row, column], :, row, column]
            assert torch.equal(fused[:, row, column], sent.max(dim=0).values)


def test_attention_is_the_softmax_of_how_alike_the_egos_cell_is() -> None:
    features, present = maps()
    fused = attend(features, present)
    for row in range(5):
        for column in range(6):
            sent = features[present[:, row, column], :, row, column]
            alike = sent @ features[0, :, row, column] / math.sqrt(32)
            assert torch.allclose(
                fused[:, row, column], torch.softmax(alike, dim=0) @ sent, atol=1e-5
            )


@given(seed=st.integers(0, 10_000), robots=st.integers(1, 6))
def test_attention_weights_sum_to_one(seed: int, robots: int) -> None:
    features, present = maps(robots, seed)
    # A channel that everybody has the same keeps its value only so.
    features[:, 7] = 0.625
    fused = attend(features, present)
    assert torch.allclose(fused[7], torch.full((5, 6), 0.625), atol=1e-5)
    sent = features.masked_fill(~present[:, None], math.nan)
    low = torch.nan_to_num(sent, nan=9.0).amin(dim=0)
    high = torch.nan_to_num(sent, nan=-9.0).amax(dim=0)
    assert (fused >= low - 1e-5).all()
    assert (fused <= high + 1e-5).all()


@BOTH
def test_robots_that_agree_change_nothing(fuse: Fuse) -> None:
    features, present = maps(1)
    same = features.expand(5, -1, -1, -1)
    assert torch.allclose(fuse(same, present.expand(5, -1, -1)), features[0], atol=1e-6)


def test_a_helper_that_sees_what_the_ego_sees_weighs_more_than_one_that_does_not() -> None:
    ego = torch.zeros(32, 1, 1)
    ego[:16] = 1.0
    other = 1.0 - ego
    fused = attend(torch.stack([ego, ego, other]), torch.ones(3, 1, 1, dtype=torch.bool))
    assert fused[0] > 2 / 3
    assert fused[31] < 1 / 3
