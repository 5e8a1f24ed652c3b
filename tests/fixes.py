"""Relative poses without images: a sensor whose observations are the measurements themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pflut.geometry import relative_headings
from pflut.localization.relative_pose_fix import RelativePoseFix
from pflut.localization.relative_pose_model import RelativePoseModel
from pflut.reference_map import ReferenceMap

REFERENCES = np.array(
    [[-3.0, -2.0, 0.3], [3.0, -2.0, 2.0], [3.0, 2.0, -1.0], [-3.0, 2.0, 3.0], [0.0, 3.0, 1.0]]
)


@dataclass
class Matcher:
    """Gives the observation itself as the matches."""

    reference_map: ReferenceMap
    near_range: float = 0.3
    max_range: float = 20.0

    def match(self, poses: np.ndarray, observation: Any) -> Any:
        return observation


class ToldFixes(RelativePoseModel):
    """Takes lists of `RelativePoseFix` for observations."""

    def __init__(self, references: np.ndarray = REFERENCES, **options: float) -> None:
        super().__init__(Matcher(ReferenceMap.of_poses(references)), **options)

    def fixes(self, poses: Any, observation: Any) -> list[RelativePoseFix]:
        return list(observation)


def measured(
    pose: np.ndarray,
    *,
    references: np.ndarray = REFERENCES,
    std: float = 0.01,
    rng: np.random.Generator | None = None,
) -> list[RelativePoseFix]:
    """What the references say at a pose; exactly, or with noise that is normal and correlated."""
    covariance = std**2 * np.array([[1.0, 0.3], [0.3, 1.5]])
    found = []
    for i, reference in enumerate(references):
        heading_l, heading_r, _ = relative_headings(reference, pose)
        headings = np.array([heading_l, heading_r])
        if rng is not None:
            headings = headings + rng.multivariate_normal(np.zeros(2), covariance)
        found.append(RelativePoseFix(i, reference, headings, covariance))
    return found
