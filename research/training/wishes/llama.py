"""A Llama model in PyTorch, with the weights of a GGUF file in llama.cpp's own order of rows.

Touvron et al., "LLaMA: Open and Efficient Foundation Language Models", 2023; rotary embeddings of
neighbouring pairs as in Su et al., "RoFormer", 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn
from torch.nn import functional

from research.training.wishes import gguf_file


@dataclass(frozen=True, slots=True)
class Shape:
    """Sizes of a model."""

    blocks: int
    width: int
    heads: int
    key_heads: int
    hidden: int
    vocabulary: int
    rotary_base: float
    epsilon: float


class Block(nn.Module):
    """Attention, then a gated layer; layers have the names that GGUF gives their weights."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self._shape = shape
        keys = shape.width // shape.heads * shape.key_heads
        self.attn_norm = nn.RMSNorm(shape.width, shape.epsilon)
        self.attn_q = nn.Linear(shape.width, shape.width, bias=False)
        self.attn_k = nn.Linear(shape.width, keys, bias=False)
        self.attn_v = nn.Linear(shape.width, keys, bias=False)
        self.attn_output = nn.Linear(shape.width, shape.width, bias=False)
        self.ffn_norm = nn.RMSNorm(shape.width, shape.epsilon)
        self.ffn_gate = nn.Linear(shape.width, shape.hidden, bias=False)
        self.ffn_up = nn.Linear(shape.width, shape.hidden, bias=False)
        self.ffn_down = nn.Linear(shape.hidden, shape.width, bias=False)

    def forward(self, x: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
        """(examples, tokens, width), and the complex rotations (tokens, half a head)."""
        y = self.attn_norm(x)
        q = _turned(self._parted(self.attn_q(y)), turn)
        k = _turned(self._parted(self.attn_k(y)), turn)
        v = self._parted(self.attn_v(y))
        groups = self._shape.heads // self._shape.key_heads
        k, v = (t.repeat_interleave(groups, dim=1) for t in (k, v))
        seen = functional.scaled_dot_product_attention(q, k, v, is_causal=True)
        x = x + self.attn_output(seen.transpose(1, 2).flatten(2))
        y = self.ffn_norm(x)
        gated: torch.Tensor = functional.silu(self.ffn_gate(y)) * self.ffn_up(y)
        return torch.add(x, self.ffn_down(gated))

    def _parted(self, x: torch.Tensor) -> torch.Tensor:
        """(examples, tokens, heads * n) to (examples, heads, tokens, n)."""
        examples, tokens, _ = x.shape
        return x.view(examples, tokens, -1, self._shape.width // self._shape.heads).transpose(1, 2)


def _turned(x: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
    pairs = torch.view_as_complex(x.float().reshape(*x.shape[:-1], -1, 2))
    return torch.view_as_real(pairs * turn).flatten(-2).to(x.dtype)


class Llama(nn.Module):
    """The model; padding behind the tokens needs no mask, for attention looks back only."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.token_embd = nn.Embedding(shape.vocabulary, shape.width)
        self.blk = nn.ModuleList(Block(shape) for _ in range(shape.blocks))
        self.output_norm = nn.RMSNorm(shape.width, shape.epsilon)

    def forward(self, tokens: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
        """Logits (n, vocabulary) of what follows the n tokens that are wanted.

        `tokens`, `wanted`: (examples, tokens) of int64 and bool.
        """
        half = self.shape.width // self.shape.heads // 2
        speed = self.shape.rotary_base ** (-torch.arange(half, device=tokens.device) / half)
        places = torch.arange(tokens.shape[1], device=tokens.device)
        angles = torch.outer(places.float(), speed.float())
        turn = torch.polar(torch.ones_like(angles), angles)
        x = self.token_embd(tokens)
        for block in self.blk:
            x = block(x, turn)
        kept = self.output_norm(x[wanted])
        return functional.linear(kept, self.token_embd.weight)


def load(path: Path, dtype: torch.dtype = torch.bfloat16) -> Llama:
    """The model of a GGUF file. Raises ValueError where it is no Llama with tied embeddings, or is
    quantised."""
    facts, tensors = gguf_file.read(path)
    if facts.get("general.architecture") != "llama" or "output.weight" in tensors:
        raise ValueError(f"{path} is not a Llama model with tied embeddings")
    shape = Shape(
        blocks=facts["llama.block_count"],
        width=facts["llama.embedding_length"],
        heads=facts["llama.attention.head_count"],
        key_heads=facts["llama.attention.head_count_kv"],
        hidden=facts["llama.feed_forward_length"],
        vocabulary=len(tensors["token_embd.weight"]),
        rotary_base=facts["llama.rope.freq_base"],
        epsilon=facts["llama.attention.layer_norm_rms_epsilon"],
    )
    model = Llama(shape)
    model.load_state_dict({name: torch.from_numpy(tensor) for name, tensor in tensors.items()})
    return model.to(dtype)
