"""Features as numbers of codebook entries: product quantisation (Jegou et al., PAMI 2011) of a
cell's channels, as CodeFilling does for collaborative perception (Hu et al., CVPR 2024)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm.errors import PerceptionError

Floats = NDArray[np.float32]

PARTS = 8
ENTRIES = 256
ROUNDS = 25


def learn_codebook(cells: Floats, rng: np.random.Generator) -> Floats:
    """k-means of each part of the cells (N, channels): float32 (PARTS, ENTRIES, channels / PARTS).

    Raises PerceptionError for fewer than ENTRIES cells.
    """
    if len(cells) < ENTRIES:
        raise PerceptionError(f"a codebook needs {ENTRIES} cells; there are {len(cells)}")
    books = []
    for part in np.split(cells, PARTS, axis=1):
        centers = part[rng.choice(len(part), ENTRIES, replace=False)].copy()
        for _ in range(ROUNDS):
            nearest = _nearest(part, centers)
            counts = np.bincount(nearest, minlength=ENTRIES)
            sums = np.zeros((ENTRIES, part.shape[1]))
            np.add.at(sums, nearest, part)
            used = counts > 0
            centers[used] = (sums[used] / counts[used, None]).astype(np.float32)
            centers[~used] = part[rng.choice(len(part), int((~used).sum()))]
        books.append(centers)
    return np.stack(books)


def to_codes(codebook: Floats, cells: Floats) -> NDArray[np.uint8]:
    """The nearest entries of cells (N, channels): uint8 (parts, N)."""
    split = np.split(cells, len(codebook), axis=1)
    return np.stack(
        [_nearest(part, book) for part, book in zip(split, codebook, strict=True)]
    ).astype(np.uint8)


def from_codes(codebook: Floats, codes: NDArray[np.uint8]) -> Floats:
    """The reverse of `to_codes`: float32 (N, channels)."""
    return np.concatenate([book[code] for book, code in zip(codebook, codes, strict=True)], axis=1)


def _nearest(vectors: Floats, centers: Floats) -> NDArray[np.intp]:
    # |v - c|^2 without |v|^2, which is the same for all centres.
    apart = (centers**2).sum(axis=1) - 2.0 * vectors @ centers.T
    nearest: NDArray[np.intp] = apart.argmin(axis=1)
    return nearest
