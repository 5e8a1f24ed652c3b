"""The features of one image: bearings and descriptors."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import replacing
from pflut.geometry import FloatArray

FORMAT_VERSION = 1


@dataclass(frozen=True, eq=False)
class Features:
    """Local features of one image, in the order of falling response.

    Parameters
    ----------
    azimuth, elevation : array_like of shape (n,)
        Bearings in the robot frame, radians: azimuth in [0, 2 pi) counter-clockwise, elevation
        up.
    descriptors : ndarray of shape (n, D), float32 or uint8
        float32 is compared by Euclidean distance (the extractor gives unit vectors), uint8 is
        bits, compared by Hamming distance; D is then a multiple of 8 bytes.
    pixels : array_like of shape (n, 2)
        ``[u, v]`` in the image, integers are pixel centres; kept as float32.
    response : array_like of shape (n,)
        The detector's strength, large is strong; kept as float32.

    Raises
    ------
    ValueError
        If the shapes do not fit, a type is another, or a value is not finite.
    """

    azimuth: FloatArray
    elevation: FloatArray
    descriptors: NDArray[Any]
    pixels: NDArray[np.float32]
    response: NDArray[np.float32]

    def __post_init__(self) -> None:
        n = np.size(self.azimuth)
        shapes = {"azimuth": (n,), "elevation": (n,), "pixels": (n, 2), "response": (n,)}
        for name, shape in shapes.items():
            dtype = np.float64 if name in ("azimuth", "elevation") else np.float32
            values = np.ascontiguousarray(getattr(self, name), dtype=dtype)
            if values.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name}: a value is not finite")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "descriptors", self._checked_descriptors(n))

    def _checked_descriptors(self, n: int) -> NDArray[Any]:
        descriptors = np.ascontiguousarray(self.descriptors)
        if descriptors.dtype not in (np.uint8, np.float32):
            raise ValueError(f"descriptors: expected uint8 or float32, got {descriptors.dtype}")
        if descriptors.ndim != 2 or len(descriptors) != n or descriptors.shape[1] == 0:
            raise ValueError(f"descriptors: expected shape ({n}, D), got {descriptors.shape}")
        if descriptors.dtype == np.uint8 and descriptors.shape[1] % 8:
            raise ValueError(
                f"descriptors: expected a multiple of 8 bytes, got {descriptors.shape[1]}"
            )
        if descriptors.dtype == np.float32 and not np.isfinite(descriptors).all():
            raise ValueError("descriptors: a value is not finite")
        return descriptors

    def __len__(self) -> int:
        """Return the number of features."""
        return int(self.azimuth.size)

    def __getitem__(self, index: slice | NDArray[Any]) -> Features:
        """Select features by a slice, an index array or a mask."""
        return Features(*(getattr(self, item.name)[index] for item in fields(self)))

    @property
    def is_binary(self) -> bool:
        """Whether the descriptors are bits, compared by Hamming distance."""
        return bool(self.descriptors.dtype == np.uint8)

    @cached_property
    def squared_norms(self) -> NDArray[np.float32]:
        """The descriptors' squared lengths, shape (n,); zeros for bits, which need none."""
        if self.is_binary:
            return np.zeros(len(self), dtype=np.float32)
        return np.asarray(np.einsum("ij,ij->i", self.descriptors, self.descriptors))

    @classmethod
    def empty(cls, *, binary: bool = False) -> Features:
        """Return zero features, of SIFT's or of ORB's kind."""
        none = np.empty(0)
        descriptors = np.empty((0, 32), np.uint8) if binary else np.empty((0, 128), np.float32)
        return cls(none, none, descriptors, np.empty((0, 2), np.float32), np.empty(0, np.float32))

    def save(self, path: str | Path) -> None:
        """Write the features to an ``.npz`` file without pickle, atomically.

        Parameters
        ----------
        path : str or Path
            Ends in ``.npz``. Its folder must exist.
        """
        if Path(path).suffix != ".npz":
            raise ValueError(f"{path}: expected a name that ends in .npz")
        arrays = {item.name: getattr(self, item.name) for item in fields(self)}
        with replacing(path) as temporary:
            np.savez(temporary, format_version=FORMAT_VERSION, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Features:
        """Read what `save` wrote.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Features

        Raises
        ------
        ValueError
            If the file is truncated, of another kind or of another version; naming the file.
        OSError
            If it cannot be read.
        """
        names = [item.name for item in fields(cls)]
        try:
            # a file object of our own: NumPy leaks the one it opens where a file is broken
            with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                version = int(file["format_version"])
                if version != FORMAT_VERSION:
                    raise ValueError(f"format version {version}, expected {FORMAT_VERSION}")
                return cls(*(file[name] for name in names))
        except KeyError as error:
            raise ValueError(f"{path}: not a feature file: {error.args[0]}") from None
        except (ValueError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{path}: not a readable feature file: {error}") from None
