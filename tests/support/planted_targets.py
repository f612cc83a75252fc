"""Targets of `make fuzz` with a fault each, which the fuzzer must find."""

from __future__ import annotations

import os
import signal
import time

from research.fuzz.limits import HANG_CPU_S, JUMP_MB
from research.fuzz.target import Target


def _crash(data: bytes) -> None:
    if data[:1] == b"B" and data[1:2] == b"U":
        raise KeyError("planted")
    if data[:1] == b"V":
        raise ValueError("allowed")


def _hang(data: bytes) -> None:
    if data[:1] == b"H":
        until = time.process_time() + 1.5 * HANG_CPU_S
        while time.process_time() < until:
            pass


def _endless(data: bytes) -> None:
    while data[:1] == b"E":
        pass


def _jump(data: bytes) -> None:
    if data[:1] == b"J":
        bytearray(b"J" * int(2 * JUMP_MB * 2**20))


def _die(data: bytes) -> None:
    if data[:1] == b"D":
        os.kill(os.getpid(), signal.SIGSEGV)


CRASH = Target(_crash, (ValueError,), max_bytes=16)
HANG = Target(_hang, ())
ENDLESS = Target(_endless, ())
JUMP = Target(_jump, ())
DIE = Target(_die, ())
