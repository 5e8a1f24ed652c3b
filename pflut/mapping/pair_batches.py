"""Pairs of images in batches, and the files that go with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pflut.features import Features
from pflut.mapping.feature_blocks import BLOCK, FeatureBlock

BATCH = 500
"""Pairs of a batch, a second's work or two: what is lost when a process is killed."""
KEPT_BLOCKS = 8
"""Blocks of features that a process has in memory."""


@dataclass(frozen=True, eq=False)
class PairBatches:
    """Pairs of images in batches, each of which needs few blocks of features.

    Parameters
    ----------
    folder : Path
        Where the blocks are, and the files of the batches that are done.
    blocks : tuple of str
        The names of the blocks, in the order of the images.
    pairs : ndarray of shape (n, 2), int64
        The smaller index first, each pair once.
    size : int
        Pairs of a batch; the last one may have fewer.
    """

    folder: Path
    blocks: tuple[str, ...]
    pairs: NDArray[np.int64]
    size: int = BATCH
    _kept: dict[int, FeatureBlock] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        # those of the same two blocks one after the other
        keys = (self.pairs[:, 1], self.pairs[:, 0], *(self.pairs // BLOCK).T[::-1])
        object.__setattr__(self, "pairs", self.pairs[np.lexsort(keys)])

    def __len__(self) -> int:
        """Return the number of batches."""
        return -(-len(self.pairs) // self.size)

    def __getitem__(self, number: int) -> NDArray[np.int64]:
        """Give the pairs of a batch."""
        return self.pairs[number * self.size : (number + 1) * self.size]

    def file(self, number: int) -> Path:
        """Name the file that keeps a batch's links."""
        return self.folder / f"batch_{number:06d}.npz"

    def missing(self) -> list[int]:
        """Give the batches that are not done."""
        return [number for number in range(len(self)) if not self.file(number).is_file()]

    def block(self, number: int) -> FeatureBlock:
        """Read a block of features; the last few stay in memory."""
        if number not in self._kept:
            while len(self._kept) >= KEPT_BLOCKS:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = FeatureBlock.load(self.folder / f"{self.blocks[number]}.npz")
        return self._kept[number]

    def image(self, image: int) -> Features:
        """Give the features of an image; asked for in order, each block is read once."""
        block, place = divmod(image, BLOCK)
        return self.block(block).image(place)
