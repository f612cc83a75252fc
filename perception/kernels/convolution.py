"""Convolutions in C: layers with their weights as network.c wants them, and threads for them."""

from __future__ import annotations

import ctypes
import math
import threading
import weakref

import numpy as np
from numpy.typing import NDArray

from perception.kernels.library import pointer

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

PANEL = 16
"""Channels that are written come in multiples of this."""
TILE = 4
"""Cells along one side of what a tile of Winograd's gives."""
_TO_TILE = np.array(
    [
        [1 / 4, 0, 0],
        [-1 / 6, -1 / 6, -1 / 6],
        [-1 / 6, 1 / 6, -1 / 6],
        [1 / 24, 1 / 12, 1 / 6],
        [1 / 24, -1 / 12, 1 / 6],
        [0, 0, 1],
    ]
)
"""G of F(4, 3) in Lavin and Gray, CVPR 2016."""


class Workers:
    """The threads that share a layer, and the memory that each thread's layers write to.

    May be used from several threads: one has the others' help at a time.
    """

    def __init__(self, library: ctypes.CDLL, threads: int) -> None:
        self.library = library
        self.threads = threads
        self.team: int | None = library.team_make(threads) if threads > 1 else None
        if self.team is not None:
            # Not at the process's end: a thread may still be in a layer.
            weakref.finalize(self, library.team_end, self.team).atexit = False
        self._kept = threading.local()

    def buffer(self, name: str, shape: tuple[int, ...]) -> Floats:
        """Float32 memory of the calling thread, with what was last left in it."""
        kept: dict[str, Floats] = self._kept.__dict__.setdefault("buffers", {})
        size = math.prod(shape)
        if name not in kept or kept[name].size < size:
            kept[name] = np.empty(size, np.float32)
        return kept[name][:size].reshape(shape)


class Convolution:
    """A convolution with its bias; weights float32 (after, before, kernel, kernel), bias (after,).

    Outputs are padded with channels of 0 to a multiple of PANEL.
    """

    def __init__(
        self, workers: Workers, weights: Floats, bias: Floats, stride: int = 1, *, relu: bool = True
    ) -> None:
        lacking = -len(weights) % PANEL
        weights = np.pad(weights, ((0, lacking), (0, 0), (0, 0), (0, 0)))
        self._workers = workers
        self._bias = np.pad(bias, (0, lacking)).astype(np.float32)
        self.after, self.before, self._kernel = weights.shape[:3]
        self._stride, self._relu = stride, relu
        self._tiled = self._kernel == 3 and stride == 1
        if self._tiled:
            exact = weights.astype(np.float64)
            taps = np.einsum("ia,jb,ocab->ijco", _TO_TILE, _TO_TILE, exact).reshape(
                36, self.before, -1, PANEL
            )
            packed = taps.transpose(0, 2, 1, 3)
        else:
            taps = weights.transpose(2, 3, 1, 0).reshape(-1, self.after // PANEL, PANEL)
            packed = taps.transpose(1, 0, 2)
        self._weights = np.ascontiguousarray(packed, dtype=np.float32)

    def __call__(
        self,
        image: Floats,
        out: Floats,
        add: Floats | None = None,
        repeat: int = 1,
        needed: Flags | None = None,
    ) -> None:
        """Writes the convolution of an image (rows, columns, before) to `out`.

        Images may be views of some channels of wider ones. `add`, of the shape of `out`, is added:
        before negative values become 0 at a stride of 1 with a kernel of 3, after that else.
        `repeat`: how often each cell is written along both axes; only without tiles.
        `needed` (see `tiles`): the others become 0; only with tiles, of a kernel of 3 at a stride
        of 1.
        """
        rows, columns, _ = image.shape
        workers, library = self._workers, self._workers.library
        if self._tiled:
            size = workers.threads * library.scratch3(self.before, self.after)
            library.convolve3(
                *(workers.team, pointer(image), _pitch(image), rows, columns, self.before),
                *(pointer(self._weights), pointer(self._bias), self.after),
                *(pointer(add), _pitch(add), self._relu, pointer(needed)),
                *(pointer(out), _pitch(out), pointer(workers.buffer("scratch", (size,)))),
            )
        else:
            size = workers.threads * library.scratch(self._kernel, self.before, self.after)
            library.convolve(
                *(workers.team, pointer(image), _pitch(image), rows, columns, self.before),
                *(self._kernel, self._stride, pointer(self._weights), pointer(self._bias)),
                *(self.after, pointer(add), _pitch(add), self._relu, repeat, pointer(out)),
                *(_pitch(out), *out.shape[:2], pointer(workers.buffer("scratch", (size,)))),
            )


def tiles(cells: Flags) -> Flags:
    """Which tiles hold a cell (rows, columns) that is true."""
    rows, columns = cells.shape
    padded = _padded(cells, 0, 0, -rows % TILE, -columns % TILE)
    across = padded[:, ::TILE].copy()
    for i in range(1, TILE):
        across |= padded[:, i::TILE]
    both = across[::TILE].copy()
    for i in range(1, TILE):
        both |= across[i::TILE]
    return both


def reached(cells: Flags, steps: int = 1) -> Flags:
    """Which cells have one that is true at most `steps` rows and columns away."""
    rows, columns = cells.shape
    padded = _padded(cells, steps, steps, steps, steps)
    across = padded[:, :columns].copy()
    for i in range(1, 2 * steps + 1):
        across |= padded[:, i : i + columns]
    both = across[:rows].copy()
    for i in range(1, 2 * steps + 1):
        both |= across[i : i + rows]
    return both


def _padded(cells: Flags, above: int, left: int, below: int, right: int) -> Flags:
    """With so many rows and columns that are false around."""
    rows, columns = cells.shape
    padded = np.zeros((above + rows + below, left + columns + right), dtype=np.bool_)
    padded[above : above + rows, left : left + columns] = cells
    return padded


def _pitch(image: Floats | None) -> int:
    """Floats from one cell to the next."""
    return 0 if image is None else image.strides[1] // image.itemsize
