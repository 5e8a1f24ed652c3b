"""Match images with references that are always the same, each pair once."""

from __future__ import annotations

from collections.abc import Sequence

from pflut.correspondences import Correspondences
from pflut.features.features import Features
from pflut.features.matching import match_many


class ReferenceMatcher:
    """Matches an image with some of its references, and remembers the matches of the last image.

    Parameters
    ----------
    references : sequence of Features
    ratio : float
        Of the ratio test, in (0, 1].
    mutual : bool
        Whether matches must be each other's nearest.

    Raises
    ------
    ValueError
        If the ratio is out of range.
    """

    def __init__(self, references: Sequence[Features], *, ratio: float, mutual: bool) -> None:
        if not 0.0 < ratio <= 1.0:
            raise ValueError(f"ratio: expected in (0, 1], got {ratio}")
        self.references = tuple(references)
        self.ratio = ratio
        self.mutual = mutual
        self._last: Features | None = None
        self._matched: dict[int, Correspondences] = {}

    def __call__(self, image: Features, indices: Sequence[int]) -> list[Correspondences]:
        """Match an image with references.

        Parameters
        ----------
        image : Features
            The query view R.
        indices : sequence of int
            Of the references, the views L.

        Returns
        -------
        list of Correspondences
            One for each reference.
        """
        if image is not self._last:
            self._last, self._matched = image, {}
        new = [index for index in indices if index not in self._matched]
        references = [self.references[index] for index in new]
        pairs = match_many(references, image, ratio=self.ratio, mutual=self.mutual)
        self._matched.update(zip(new, pairs, strict=True))
        return [self._matched[index] for index in indices]
