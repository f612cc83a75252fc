"""Arrays as NumPy stores them (.npy)."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_npy(path: Path) -> NDArray[Any]:
    """The array of a file. Pickles, whose stored text may run code, are refused.

    Raises OSError when it cannot be read, and ValueError that says what is wrong with its content.
    """
    try:
        with path.open("rb") as file:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    except (EOFError, SyntaxError, TokenError) as error:
        # NumPy reads a header as Python's text, and lets some of that reader's errors through.
        raise ValueError(f"its header is malformed: {error}") from error
    except MemoryError as error:
        raise ValueError(f"it names more than there is memory for: {error}") from error
    return array
