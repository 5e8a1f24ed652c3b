"""Features of many images in blocks, small and exact, for processes and machines to share.

Descriptors are kept as whole numbers. Products of them, summed, stay whole numbers below 2^24,
which float32 holds without rounding: matches are the same whatever the order that a matrix product
is summed in, so on any number of threads.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pflut._files import checksum, read_arrays, replacing
from pflut.features import Features
from pflut.geometry import FloatArray

BLOCK = 32
"""Images of a block; the last one may have fewer."""
SCALE = 4000.0
"""Of float descriptors, in whole numbers: lengths up to 1.02 have squares below 2^24."""
MAX_LENGTH = 1.02
NO_DESCRIPTOR = 1


@dataclass(frozen=True, eq=False)
class FeatureBlock:
    """What matching needs of the features of some images in a row.

    Parameters
    ----------
    offsets : ndarray of shape (k + 1,), int64
        The features of image i are those from ``offsets[i]`` to ``offsets[i + 1]``.
    bearings : ndarray of shape (m, 2)
        Azimuth and elevation, radians.
    descriptors : ndarray of shape (m, D), int16 or uint8
        Whole numbers, `SCALE` times the float descriptors; bits as they are.
    """

    offsets: NDArray[np.int64]
    bearings: FloatArray
    descriptors: NDArray[np.generic]

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.offsets) - 1

    @classmethod
    def of(cls, features: Sequence[Features]) -> FeatureBlock:
        """Make the block of some images.

        Parameters
        ----------
        features : sequence of Features
            With one kind of descriptor; of floats none longer than 1.02.

        Returns
        -------
        FeatureBlock

        Raises
        ------
        ValueError
            If a descriptor is longer, or of another kind.
        """
        kinds = {(f.descriptors.dtype.str, f.descriptors.shape[1]) for f in features if len(f)}
        if len(kinds) > 1:
            raise ValueError(f"features: expected one kind of descriptor, got {sorted(kinds)}")
        (kind, size) = kinds.pop() if kinds else (np.dtype(np.float32).str, NO_DESCRIPTOR)
        counts = [len(f) for f in features]
        rows = [f.descriptors for f in features if len(f)]
        descriptors = np.concatenate(rows) if rows else np.empty((0, size), kind)
        if descriptors.dtype != np.uint8:
            longest = max((float(f.squared_norms.max()) for f in features if len(f)), default=0.0)
            if longest > MAX_LENGTH**2:
                raise ValueError(
                    f"descriptors: expected unit vectors, got one of length {longest**0.5:.4g}"
                )
            descriptors = np.rint(SCALE * descriptors).astype(np.int16)
        bearings = [np.column_stack([f.azimuth, f.elevation]) for f in features]
        return cls(np.concatenate([[0], np.cumsum(counts)]), np.concatenate(bearings), descriptors)

    def image(self, index: int) -> Features:
        """Give an image's features as the matcher takes them.

        Parameters
        ----------
        index : int
            Of the image in this block.

        Returns
        -------
        Features
            Bearings and descriptors, as whole numbers; pixels and responses are zero.
        """
        span = slice(*self.offsets[index : index + 2])
        count = span.stop - span.start
        descriptors = self.descriptors[span]
        if descriptors.dtype != np.uint8:
            descriptors = descriptors.astype(np.float32)
        azimuth, elevation = self.bearings[span].T
        pixels, response = np.zeros((count, 2), np.float32), np.zeros(count, np.float32)
        return Features(azimuth, elevation, descriptors, pixels, response)

    @property
    def digest(self) -> str:
        """A hash of the content."""
        return checksum("", self._arrays())

    def save(self, path: Path) -> None:
        """Write the block to a `.npz` file without pickle, atomically."""
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **self._arrays())  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> FeatureBlock:
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If the file is none, or damaged.
        OSError
            If it cannot be opened.
        """
        stored = read_arrays(path, "block of features")
        try:
            return cls(*(stored[item.name] for item in fields(cls)))
        except KeyError:
            raise ValueError(f"{path}: not a block of features of pflut, or damaged") from None

    def _arrays(self) -> dict[str, NDArray[np.generic]]:
        return {item.name: getattr(self, item.name) for item in fields(self)}


def in_blocks(features: Iterable[Features]) -> Iterator[FeatureBlock]:
    """Give the blocks of images one after the other: no more than one is in memory.

    Parameters
    ----------
    features : iterable of Features

    Yields
    ------
    FeatureBlock
        Of `BLOCK` images; the last one of what is left.
    """
    waiting: list[Features] = []
    for one in features:
        waiting.append(one)
        if len(waiting) == BLOCK:
            yield FeatureBlock.of(waiting)
            waiting = []
    if waiting:
        yield FeatureBlock.of(waiting)


def digest_of(blocks: Iterable[str]) -> str:
    """Give one hash for the hashes of all blocks in their order."""
    return hashlib.sha256("\n".join(blocks).encode()).hexdigest()
