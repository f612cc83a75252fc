"""How a process keeps the memory that it has freed, and how often it looks for what to free.

A frame of the detector allocates and frees a few hundred megabytes in pieces of megabytes. glibc by
default hands each piece back to the kernel and asks for it again, zeroed page by page, in the next
frame: a quarter of the time in which an ego fuses six robots. See mallopt(3).
"""

from __future__ import annotations

import ctypes
import gc

_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_M_ARENA_MAX = -8
_LARGEST_PIECE = 32 << 20
"""Bytes; the most that older glibc accepts, and more than any feature map or canvas has."""
_KEPT = 256 << 20
"""Bytes at the end of the heap that stay with the process."""
_YOUNG = 50_000
"""Objects between two looks for cycles among them. A hundred robots' messages of one control cycle
are tens of thousands; with Python's own 700 the collector goes through all that the process
remembers in the midst of a decision."""


def keep_freed_memory() -> None:
    """Lets this process reuse what it has freed, in all threads; elsewhere than on glibc nothing
    changes. Call it before there are other threads."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, _LARGEST_PIECE)
    mallopt(_M_TRIM_THRESHOLD, _KEPT)
    # Further arenas are maps of 64 MB at most, in which large pieces do not fit.
    mallopt(_M_ARENA_MAX, 1)


def collect_rarely() -> None:
    """Keeps the collector of cycles off a control cycle: what is there by now stays for good, and
    new objects are looked at by the ten thousands. Call it when the process has read its world."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(_YOUNG)
