"""Find images that look alike without matching them: visual words and image signatures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WORDS = 32
MAX_TRAINING = 20_000
NO_ROWS = np.empty((0, 1), np.float32)


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """Visual words, and signatures of images made with them (VLAD).

    Parameters
    ----------
    words : ndarray of shape (k, D), float32
        The centres of the clusters of descriptors.

    References
    ----------
    H. Jegou, M. Douze, C. Schmid, P. Perez, "Aggregating local descriptors into a compact image
    representation", CVPR 2010; R. Arandjelovic, A. Zisserman, "All about VLAD", CVPR 2013
    (normalisation within a word).
    """

    words: NDArray[np.float32]

    @classmethod
    def learn(
        cls, descriptors: Sequence[NDArray[np.generic]], *, words: int = WORDS, seed: int = 0
    ) -> Vocabulary:
        """Cluster the descriptors of some images.

        Parameters
        ----------
        descriptors : sequence of ndarray of shape (n, D)
            An array an image; uint8 ones are binary (ORB) and are taken bit by bit. Images without
            any may have another D.
        words : int
            Number of clusters, fewer if there are fewer descriptors.
        seed : int
            The same seed gives the same words.

        Returns
        -------
        Vocabulary
        """
        import cv2

        seen = [d for d in descriptors if len(d)] or [*descriptors[:1], NO_ROWS][:1]
        rows = np.concatenate([_as_float(d) for d in seen])
        rng = np.random.default_rng(seed)
        if len(rows) > MAX_TRAINING:
            rows = rows[rng.choice(len(rows), MAX_TRAINING, replace=False)]
        words = min(words, len(rows))
        if words < 2:
            return cls(rows[:1] if len(rows) else np.zeros((1, rows.shape[1]), np.float32))
        # labels of our own, since OpenCV's initial ones come from its global random state
        start = rows[rng.choice(len(rows), words, replace=False)]
        labels = np.argmax(rows @ start.T - 0.5 * (start**2).sum(axis=1), axis=1)
        criteria = (cv2.TERM_CRITERIA_MAX_ITER + cv2.TERM_CRITERIA_EPS, 15, 1e-3)
        _, _, centers = cv2.kmeans(
            rows,
            words,
            labels.astype(np.int32)[:, None],
            criteria,
            1,
            cv2.KMEANS_USE_INITIAL_LABELS,
        )
        return cls(np.asarray(centers, dtype=np.float32))

    def signature(self, descriptors: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return an image's signature: the residuals to the words, summed a word, normalised.

        Parameters
        ----------
        descriptors : ndarray of shape (n, D)

        Returns
        -------
        ndarray of shape (k * D,), float32
            Of length one; zero without descriptors.
        """
        k, size = self.words.shape
        if not len(descriptors):
            return np.zeros(k * size, np.float32)
        rows = _as_float(descriptors)
        nearest = np.argmax(rows @ self.words.T - 0.5 * (self.words**2).sum(axis=1), axis=1)
        sums = np.zeros((k, size), np.float32)
        np.add.at(sums, nearest, rows - self.words[nearest])
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        sums /= np.where(lengths > 0.0, lengths, 1.0)
        flat = sums.ravel()
        length = float(np.linalg.norm(flat))
        return flat / length if length > 0.0 else flat

    def signatures(self, descriptors: Iterable[NDArray[np.generic]]) -> NDArray[np.float32]:
        """Return the signatures of several images, at least one.

        Parameters
        ----------
        descriptors : iterable of ndarray of shape (n, D)
            An array an image.

        Returns
        -------
        ndarray of shape (N, k * D), float32
        """
        return np.stack([self.signature(rows) for rows in descriptors])


@dataclass(frozen=True, eq=False)
class Gallery:
    """Signatures of images, N of them, that others are compared with.

    Parameters
    ----------
    vocabulary : Vocabulary
    signatures : ndarray of shape (N, S), float32
        Made with it.
    """

    vocabulary: Vocabulary
    signatures: NDArray[np.float32]

    @classmethod
    def learn(cls, descriptors: Sequence[NDArray[np.generic]]) -> Gallery:
        """Make visual words of some images, and signatures of the same images with them.

        Parameters
        ----------
        descriptors : sequence of ndarray of shape (n, D)
            As `Vocabulary.learn` takes them.

        Returns
        -------
        Gallery
        """
        vocabulary = Vocabulary.learn(descriptors)
        return cls(vocabulary, vocabulary.signatures(descriptors))

    def __getitem__(self, indices: NDArray[np.intp]) -> Gallery:
        """Select images; the visual words stay."""
        return Gallery(self.vocabulary, self.signatures[indices])

    def similarity(self, descriptors: NDArray[np.generic]) -> NDArray[np.float32]:
        """Compare an image with all of them, without matching.

        Parameters
        ----------
        descriptors : ndarray of shape (n, D)

        Returns
        -------
        ndarray of shape (N,), float32
            Cosines in [-1, 1]; zero for an image without descriptors.
        """
        similar: NDArray[np.float32] = self.signatures @ self.vocabulary.signature(descriptors)
        return similar


def _as_float(descriptors: NDArray[np.generic]) -> NDArray[np.float32]:
    """Return float descriptors as they are, binary ones bit by bit."""
    if descriptors.dtype == np.uint8:
        return np.unpackbits(descriptors.view(np.uint8), axis=1).astype(np.float32)
    return np.ascontiguousarray(descriptors, dtype=np.float32)
