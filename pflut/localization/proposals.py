"""Where a lost robot may be: poses drawn from the image's likelihood itself, or blindly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import TWO_PI, FloatArray, relative_headings, wrap_to_pi
from pflut.localization.initial_poses import Bounds, check_bounds, uniform_poses
from pflut.localization.reference_image_model import CANDIDATES, ReferenceImageModel


class PoseProposal(Protocol):
    """What `Recovery` asks of a proposal."""

    def propose(
        self, observation: Any, n: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw poses.

        Parameters
        ----------
        observation : object
            Whatever `ParticleFilter.update` was handed.
        n : int
        rng : numpy.random.Generator

        Returns
        -------
        poses : ndarray of shape (n, 3)
        log_ratio : ndarray of shape (n,)
            log of u / q: the density of where the robot may be without any image, over that of
            the draw. -inf for a pose where it cannot be.
        """
        ...  # pragma: no cover


@dataclass(frozen=True)
class UniformProposal:
    """Draw poses uniformly from a rectangle.

    Parameters
    ----------
    bounds : tuple (xmin, ymin, xmax, ymax)
        Metres.

    Raises
    ------
    ValueError
        If the bounds are not finite or the wrong way round.
    """

    bounds: Bounds

    def __post_init__(self) -> None:
        check_bounds(self.bounds)

    def propose(
        self, observation: Any, n: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw poses: u is q, the ratio one. See `PoseProposal`."""
        return uniform_poses(self.bounds, n, rng), np.zeros(n)


class _Component(NamedTuple):
    """A reference's part of the mixture.

    ``cells`` (B, B) probabilities of the cells of (heading_l, heading_r), ``share`` of the draws.
    """

    reference: FloatArray
    cells: NDArray[np.float64]
    share: float


class ReferenceProposal:
    """Draw poses from the posteriors of the references that match the image best.

    Each of these references gives a posterior over the direction to the robot and the robot's
    heading; the distance, which no pair of images tells, is uniform up to the sensor's range. The
    mixture over the references is defensive: posteriors are flattened, no reference is left out
    for its evidence alone, and a share is drawn from all of the rectangle, so that no weight u / q
    exceeds one over that share.

    Parameters
    ----------
    sensor : ReferenceImageModel
    bounds : tuple (xmin, ymin, xmax, ymax), optional
        Metres: where the robot may be. By default 1 m around the references.
    max_references : int
        So many references with the most matches.
    flattening : float
        In (0, 1]: exponent on the sensor's tempered posterior of a pair.
    uniform_share : float
        In (0, 1]: drawn from the rectangle.

    Raises
    ------
    ValueError
        If an option is out of its range.

    References
    ----------
    S. Thrun, D. Fox, W. Burgard, F. Dellaert, "Robust Monte Carlo localization for mobile robots",
    Artificial Intelligence 128, 2001, section 4 (sampling from the likelihood).
    """

    def __init__(
        self,
        sensor: ReferenceImageModel,
        *,
        bounds: Bounds | None = None,
        max_references: int = 5,
        flattening: float = 0.5,
        uniform_share: float = 0.1,
    ) -> None:
        self.bounds = sensor.reference_map.bounds() if bounds is None else bounds
        check_bounds(self.bounds)
        if max_references < 1:
            raise ValueError(f"max_references: expected at least 1, got {max_references}")
        for name, value in (("flattening", flattening), ("uniform_share", uniform_share)):
            if not 0.0 < value <= 1.0:
                raise ValueError(f"{name}: expected in (0, 1], got {value}")
        self.sensor = sensor
        self.max_references = max_references
        self.flattening = flattening
        self.uniform_share = uniform_share

    def propose(
        self, observation: Any, n: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw poses from the mixture. See `PoseProposal`."""
        components = self._components(observation)
        shares = [(1.0 - self.uniform_share) * component.share for component in components]
        counts = rng.multinomial(n, [*shares, max(1.0 - sum(shares), 0.0)])
        drawn = [
            self._draw(component, int(count), rng)
            for component, count in zip(components, counts, strict=False)
        ]
        poses = np.concatenate([*drawn, uniform_poses(self.bounds, int(counts[-1]), rng)])
        return poses, self._log_ratio(components, poses)

    def _components(self, observation: Any) -> list[_Component]:
        """Make the mixture: the best references, evidence counting for half of their shares."""
        matches = self.sensor.match(
            None, observation, max_candidates=CANDIDATES * self.max_references
        )[: self.max_references]
        factor = self.flattening * self.sensor.temperature
        cells, evidence = [], np.empty(len(matches))
        for k, match in enumerate(matches):
            grid = self.sensor.likelihood.log_likelihood_grid(match.correspondences)
            top = float(grid.max())
            values = np.exp(np.float32(factor) * (grid - np.float32(top))).astype(np.float64)
            total = float(values.sum())
            cells.append(values / total)
            evidence[k] = factor * top + np.log(total / values.size)
        likely = np.exp(evidence - evidence.max(initial=-np.inf))
        return [
            _Component(
                self.sensor.reference_map.poses[match.index],
                cells[k],
                0.5 * likely[k] / likely.sum() + 0.5 / len(matches),
            )
            for k, match in enumerate(matches)
        ]

    def _draw(self, component: _Component, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw a cell, a place in it, and a distance."""
        bins = len(component.cells)
        steps = np.cumsum(component.cells)
        chosen = np.searchsorted(steps, rng.random(n) * steps[-1], side="right")
        row, column = np.divmod(np.minimum(chosen, bins * bins - 1), bins)
        theta = (row + rng.random(n)) * (TWO_PI / bins)
        phi = (column + rng.random(n)) * (TWO_PI / bins)
        x, y, heading = component.reference
        direction = heading + theta
        # distances in (0, range]: at no distance there is no direction
        distance = self.sensor.max_range * (1.0 - rng.random(n))
        return np.column_stack(
            [
                x + distance * np.cos(direction),
                y + distance * np.sin(direction),
                wrap_to_pi(direction + np.pi - phi),
            ]
        )

    def _log_ratio(self, components: list[_Component], poses: FloatArray) -> FloatArray:
        """Give log(u / q)."""
        low_x, low_y, high_x, high_y = self.bounds
        x, y = poses[:, 0], poses[:, 1]
        inside = (x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y)
        volume = (high_x - low_x) * (high_y - low_y) * TWO_PI
        reach = self.sensor.max_range
        # q / u: the uniform part of the mixture, then the references' (dx dy = r dr dtheta)
        ratio = np.full(len(poses), 1.0 if not components else self.uniform_share)
        for component in components:
            theta, phi, distance = relative_headings(component.reference, poses)
            bins = len(component.cells)
            row, column = ((angle * (bins / TWO_PI)).astype(np.intp) for angle in (theta, phi))
            density = component.cells[row % bins, column % bins] * (bins / TWO_PI) ** 2
            density = np.where(distance <= reach, density / (reach * distance), 0.0)
            ratio += (1.0 - self.uniform_share) * component.share * volume * density
        return np.where(inside, -np.log(ratio), -np.inf)
