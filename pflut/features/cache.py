"""Features on disk, keyed by what they were computed from."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._cache import cache_dir
from pflut.features.extractor import FeatureExtractor
from pflut.features.features import FORMAT_VERSION, Features


class FeatureCache:
    """A folder of features, one file for each image and extractor.

    The name of a file is a hash of the image's content, of every setting of the extractor and
    its camera, and of OpenCV's version: a changed image or option is another entry, never a
    stale one. Files are written whole or not at all, so that a run may be interrupted and
    several may share the folder; a file that does not read is computed again.

    Parameters
    ----------
    folder : str or Path, optional
        Created if missing. Without it ``features`` in the user's cache folder.

    Raises
    ------
    OSError
        If the folder cannot be created.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = cache_dir() / "features" if folder is None else Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, extractor: FeatureExtractor, image: NDArray[Any]) -> Features:
        """Give the features of an image, from disk if they are there.

        Parameters
        ----------
        extractor : FeatureExtractor
        image : ndarray, uint8
            As the extractor takes it.

        Returns
        -------
        Features

        Raises
        ------
        ValueError
            If the extractor refuses the image.
        OSError
            If the entry cannot be written.
        """
        path = self.path(extractor, image)
        try:
            return Features.load(path)
        except (FileNotFoundError, ValueError):
            features = extractor(image)
        features.save(path)
        return features

    def path(self, extractor: FeatureExtractor, image: NDArray[Any]) -> Path:
        """Give the file that an entry has, whether it is there or not."""
        import cv2

        image = np.asarray(image)
        about = (FORMAT_VERSION, cv2.__version__, extractor.settings, image.dtype.str, image.shape)
        digest = hashlib.blake2b(repr(about).encode(), digest_size=20)
        digest.update(np.ascontiguousarray(image).data)
        return self.folder / f"{digest.hexdigest()}.npz"
