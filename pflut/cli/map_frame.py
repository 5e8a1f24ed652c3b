"""Over what the verbs of ``pflut map`` draw, where the floor plan's frame may be unknown."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pflut.datasets.base import Dataset
    from pflut.geometry import FloatArray

WITHOUT_TRUTH = "no two true poses are known: drawn where odometry says"


def truth_known(dataset: Dataset) -> bool:
    """Say whether a map can be laid over the truth: whether two true poses at least are known."""
    truth = dataset.ground_truth
    return truth is not None and int(np.isfinite(truth).all(axis=1).sum()) >= 2


def without_plan(dataset: Dataset, poses: FloatArray) -> Dataset:
    """Return a dataset to draw poses over that are not in the floor plan's frame."""
    return replace(
        dataset,
        ground_truth=poses,
        floor_plan=None,
        reference_indices=np.empty(0, np.intp),
    )
