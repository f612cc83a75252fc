"""The few calls of llama.cpp that the engine needs, with Python's types and errors."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from swarm.messages import ChatMessage

_WARNING = 3
"""llama.cpp's number for the level; only warnings and errors are passed on."""


CHUNK = 256
"""Tokens of one decode, at most: how long a cancelled prompt may keep the model."""


Part = tuple[int, int, list[int], int]
"""Of one decode: a sequence, the position of the first token, tokens, how many of the last ones
get logits."""


class ModelError(Exception):
    """A file is not a model that llama.cpp can run."""


class Native:
    """A model, and a context with `sequences` parallel sequences of `context` tokens each."""

    def __init__(
        self,
        path: Path,
        *,
        sequences: int,
        context: int,
        threads: int,
        chunk: int,
        adapter: Path | None = None,
    ):
        """Loads it; `chunk` is the most tokens that one `decode` gets, `threads` the most it takes.

        `adapter`: what was learned beside the model's weights (LoRA, GGUF). Raises ModelError.
        """
        from llama_cpp import llama_cpp as lib

        self._lib: Any = lib
        self._threads = threads
        self._said: list[str] = []
        self._log = lib.llama_log_callback(self._heard)
        lib.llama_log_set(self._log, ctypes.c_void_p(0))
        lib.llama_backend_init()
        model_params = lib.llama_model_default_params()
        model_params.n_gpu_layers = 0
        self._model = lib.llama_model_load_from_file(str(path).encode(), model_params)
        if not self._model:
            said = "; ".join(self._said[-2:])
            raise ModelError(f"{path} is not a model that llama.cpp can load: {said}")
        params = lib.llama_context_default_params()
        params.n_ctx = sequences * context
        params.n_batch = params.n_ubatch = chunk
        params.n_seq_max = sequences
        params.n_threads = params.n_threads_batch = threads
        params.flash_attn_type = lib.LLAMA_FLASH_ATTN_TYPE_ENABLED
        params.kv_unified = False
        params.no_perf = True
        self._context = lib.llama_init_from_model(self._model, params)
        if not self._context:
            said = "; ".join(self._said[-2:])
            raise ModelError(f"no context of {sequences} times {context} tokens: {said}")
        if adapter is not None:
            self._add(adapter)
        self._memory = lib.llama_get_memory(self._context)
        self.vocabulary = lib.llama_model_get_vocab(self._model)
        self.vocabulary_size: int = lib.llama_vocab_n_tokens(self.vocabulary)
        self.trained_context: int = lib.llama_model_n_ctx_train(self._model)
        self._batch = lib.llama_batch_init(chunk, 0, 1)
        template = lib.llama_model_chat_template(self._model, None)
        self.template: bytes | None = template

    def _add(self, adapter: Path) -> None:
        """Adds an adapter to all that is decoded; the model frees it."""
        loaded = self._lib.llama_adapter_lora_init(self._model, str(adapter).encode())
        if not loaded:
            said = "; ".join(self._said[-2:])
            raise ModelError(f"{adapter} is not an adapter of this model: {said}")
        adapters = (self._lib.llama_adapter_lora_p_ctypes * 1)(loaded)
        scales = (ctypes.c_float * 1)(1.0)
        if self._lib.llama_set_adapters_lora(self._context, adapters, 1, scales):
            raise ModelError(f"{adapter} cannot be added to the model")

    def close(self) -> None:
        """Gives the memory back; nothing may be called afterwards."""
        self._lib.llama_batch_free(self._batch)
        self._lib.llama_free(self._context)
        self._lib.llama_model_free(self._model)

    def _heard(self, level: int, text: bytes, _: object) -> None:
        if level >= _WARNING:
            self._said = [*self._said[-20:], text.decode(errors="replace").strip()]

    # Text and tokens.

    def tokens(self, text: str, *, special: bool, begin: bool = False) -> list[int]:
        """Of a text; with `special`, control tokens that stand in it are read as such."""
        raw = text.encode()
        room = len(raw) + 2
        buffer = (self._lib.llama_token * room)()
        count = self._lib.llama_tokenize(
            self.vocabulary, raw, len(raw), buffer, room, begin, special
        )
        return list(buffer[:count])

    def piece(self, token: int) -> bytes:
        """What a token stands for; control tokens stand for nothing."""
        buffer = ctypes.create_string_buffer(256)
        size = self._lib.llama_token_to_piece(self.vocabulary, token, buffer, 256, 0, False)
        return buffer.raw[: max(0, size)]

    def ends(self, token: int) -> bool:
        """Whether a token ends an answer."""
        return bool(self._lib.llama_vocab_is_eog(self.vocabulary, token))

    def is_control(self, token: int) -> bool:
        """Whether a token is markup rather than text."""
        return bool(self._lib.llama_vocab_is_control(self.vocabulary, token))

    def chat(self, messages: Sequence[ChatMessage]) -> list[int]:
        """A prompt in the model's own chat format; models without one get a plain one.

        What a message says is never read as markup, whatever stands in it.
        """
        marks = [f"\x02{i}\x03" for i in range(len(messages))]
        if self.template is None:
            framed = "".join(
                f"{m.role}: {mark}\n\n" for m, mark in zip(messages, marks, strict=True)
            )
            framed += "assistant: "
        else:
            framed = self._framed([m.role for m in messages], marks)
        begin = bool(self._lib.llama_vocab_get_add_bos(self.vocabulary))
        found: list[int] = []
        for message, mark in zip(messages, marks, strict=True):
            before, _, framed = framed.partition(mark)
            found += self.tokens(before, special=True, begin=begin)
            found += self.tokens(message.content, special=False)
            begin = False
        return found + self.tokens(framed, special=True)

    def _framed(self, roles: list[str], contents: list[str]) -> str:
        chat = (self._lib.llama_chat_message * len(roles))()
        for i, (role, content) in enumerate(zip(roles, contents, strict=True)):
            chat[i].role, chat[i].content = role.encode(), content.encode()
        room = 400 * (len(roles) + 1)
        buffer = ctypes.create_string_buffer(room)
        size = self._lib.llama_chat_apply_template(
            self.template, chat, len(roles), True, buffer, room
        )
        if not 0 <= size <= room:
            # A template that llama.cpp does not know: ChatML is what most models were taught.
            framed = "".join(
                f"<|im_start|>{role}\n{content}<|im_end|>\n"
                for role, content in zip(roles, contents, strict=True)
            )
            return framed + "<|im_start|>assistant\n"
        return buffer.raw[:size].decode()

    # What sequences hold, and decoding.

    def keep(self, sequence: int, count: int) -> None:
        """Forgets what a sequence holds behind its first `count` tokens."""
        self._lib.llama_memory_seq_rm(self._memory, sequence, count, -1)

    def copy(self, source: int, target: int) -> None:
        """Makes `target` hold what `source` holds."""
        self._lib.llama_memory_seq_rm(self._memory, target, -1, -1)
        self._lib.llama_memory_seq_cp(self._memory, source, target, -1, -1)

    def decode(self, parts: Sequence[Part]) -> list[int]:
        """Reads tokens of several sequences.

        Returns for each part where `logits` finds its first token that gets some.
        """
        batch, n = self._batch, 0
        first = []
        for sequence, position, tokens, answers in parts:
            silent = len(tokens) - answers
            first.append(n + silent)
            for i, token in enumerate(tokens):
                batch.token[n] = token
                batch.pos[n] = position + i
                batch.n_seq_id[n] = 1
                batch.seq_id[n][0] = sequence
                batch.logits[n] = i >= silent
                n += 1
        batch.n_tokens = n
        threads = min(self._threads, free_cores())
        self._lib.llama_set_n_threads(self._context, threads, threads)
        code = self._lib.llama_decode(self._context, batch)
        if code:
            raise RuntimeError(f"llama_decode gave {code} for {n} tokens: {self._said[-1:]}")
        return first

    def logits(self, index: int) -> npt.NDArray[np.float32]:
        """Of the token at an index of the last batch, valid until the next `decode`."""
        pointer = self._lib.llama_get_logits_ith(self._context, index)
        return np.ctypeslib.as_array(pointer, shape=(self.vocabulary_size,))

    # Grammars.

    def grammar(self, text: str) -> Any:
        """A grammar that is at its start; `free` it. Raises ValueError."""
        found = self._lib.llama_sampler_init_grammar(self.vocabulary, text.encode(), b"root")
        if not found:
            raise ValueError(f"llama.cpp cannot read the grammar: {'; '.join(self._said[-2:])}")
        return found

    def free(self, grammar: Any) -> None:
        """Gives a grammar's memory back."""
        self._lib.llama_sampler_free(grammar)

    def accept(self, grammar: Any, token: int) -> None:
        """Moves a grammar on by a token that is legal."""
        self._lib.llama_sampler_accept(grammar, token)

    def legal(self, grammar: Any, tokens: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Which of the tokens may come next."""
        data = np.zeros(len(tokens), _CANDIDATE)
        data["id"] = tokens
        pointer = data.ctypes.data_as(self._lib.llama_token_data_p)
        array = self._lib.llama_token_data_array(pointer, len(tokens), -1, False)
        self._lib.llama_sampler_apply(grammar, ctypes.byref(array))
        return np.asarray(np.isfinite(data["logit"]), np.bool_)

    def features(self) -> str:
        """The processor's features that this build of llama.cpp uses."""
        return str(self._lib.llama_print_system_info().decode()).strip()


_CANDIDATE = np.dtype([("id", np.int32), ("logit", np.float32), ("p", np.float32)])
"""llama.cpp's `llama_token_data`."""


def free_cores() -> int:
    """Cores that nobody else uses right now, at least 1.

    llama.cpp's threads wait for each other hundreds of times in a decode, spinning: where they
    compete for cores with other processes, two threads were 40 times slower than one.
    """
    cores = len(os.sched_getaffinity(0))
    try:
        running = int(Path("/proc/loadavg").read_text().split()[3].split("/")[0])
    except (OSError, ValueError, IndexError):
        return cores
    return max(1, cores - (running - 1))
