"""The components of all links of a pose graph, as terms of a least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pflut.geometry import FloatArray
from pflut.mapping.graph_residuals import chords
from pflut.mapping.links import Links
from pflut.mapping.pose_graph import IndexArray
from pflut.von_mises.bessel import log_i0

LOG_TURN = float(np.log(2.0 * np.pi))
MAX_CORRELATION = 0.999
"""Between the headings of a mode: what is sharper along the rotation than that is a band."""
BROADEST = 1e-3
"""Concentration that a mode, or the rotation of a band, has at least."""
NEGLIGIBLE = 0.005
"""A component whose weight times its link's probability is less counts as nothing being known."""
MAX_PROBABILITY = 0.99
"""No link is believed more: places that look the same are beyond what a posterior can tell."""

ALL = slice(None)
_OF_BAND = np.array([[1.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class LinkTerms:
    """Modes and bands of the links' mixtures, c of them that are not negligible, in one form.

    A component says of the headings h that ``frame h`` is distributed about ``mean`` with
    ``covariance``; of a mode these are both headings, of a band the rotation and heading_l.

    Parameters
    ----------
    component : ndarray of shape (c,), int
        Their numbers among all modes, and then all bands, of the links.
    link : ndarray of shape (c,), int
        Which link a component belongs to.
    log_weight : ndarray of shape (c,)
        Of the link's probability times the component's weight.
    frame : ndarray of shape (c, 2, 2)
    mean : ndarray of shape (c, 2)
        Radians.
    covariance : ndarray of shape (c, 2, 2)
        Radians squared; infinite along a band all of whose headings are as probable.
    band : ndarray of shape (c,), bool
    null : ndarray of shape (m,)
        Of each link: minus the log of the density, weighted, that nothing is known.
    """

    component: IndexArray
    link: IndexArray
    log_weight: FloatArray
    frame: FloatArray
    mean: FloatArray
    covariance: FloatArray
    band: NDArray[np.bool_]
    null: FloatArray

    @classmethod
    def of(cls, links: Links) -> LinkTerms:
        """Take the mixtures of links apart."""
        modes, bands = len(links.weights), len(links.rotation_weights)
        of_mode = np.repeat(np.arange(len(links)), np.diff(links.component_offsets))
        of_band = np.repeat(np.arange(len(links)), np.diff(links.band_offsets))
        link = np.concatenate([of_mode, of_band])
        probability = np.minimum(links.probability, MAX_PROBABILITY)
        covariance = np.zeros((modes + bands, 2, 2))
        covariance[:modes] = mode_covariances(links.concentrations, links.couplings)
        with np.errstate(divide="ignore"):
            covariance[modes:, 0, 0] = 1.0 / np.maximum(links.rotation_concentrations, BROADEST)
            covariance[modes:, 1, 1] = 1.0 / links.rotation_heading_concentrations
        weight = probability[link] * np.concatenate([links.weights, links.rotation_weights])
        # a band's rotation is heading_l - heading_r + pi
        band_mean = np.stack([links.rotation_means - np.pi, links.rotation_headings], axis=-1)
        band = np.arange(modes + bands) >= modes
        kept = np.flatnonzero(weight >= NEGLIGIBLE)
        known = np.bincount(link[kept], weight[kept], minlength=len(links))
        return cls(
            kept,
            link[kept],
            np.log(weight[kept]),
            np.where(band[kept, None, None], _OF_BAND, np.eye(2)),
            np.concatenate([links.means, band_mean])[kept],
            covariance[kept],
            band[kept],
            2.0 * LOG_TURN - np.log(1.0 - known),
        )

    def select(self, chosen: NDArray[np.intp]) -> LinkTerms:
        """Give the components of one link by themselves."""
        (link,) = np.unique(self.link[chosen])
        return LinkTerms(
            self.component[chosen],
            np.zeros(len(chosen), np.int64),
            self.log_weight[chosen],
            self.frame[chosen],
            self.mean[chosen],
            self.covariance[chosen],
            self.band[chosen],
            self.null[link : link + 1],
        )

    def whitened(self, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Prepare the components, with noise added to the headings.

        Parameters
        ----------
        noise : ndarray of shape (m, 2, 2)
            Covariance that each link's headings get besides, radians squared.

        Returns
        -------
        whitening : ndarray of shape (c, 2, 2)
            Turns differences from the mean into numbers of unit variance.
        constant : ndarray of shape (c,)
            Minus the log of the weighted density at the mean.
        """
        added = self.frame @ noise[self.link] @ self.frame.transpose(0, 2, 1)
        total = self.covariance + added
        whitening = np.zeros_like(total)
        constant = -self.log_weight
        modes, bands = ~self.band, self.band
        whitening[modes] = np.linalg.inv(np.linalg.cholesky(total[modes]))
        constant[modes] += LOG_TURN + 0.5 * np.log(np.linalg.det(total[modes]))
        # the parts of a band are independent, and the second may be as good as uniform
        sharpness = 1.0 / np.diagonal(total[bands], axis1=1, axis2=2)
        whitening[bands, 0, 0], whitening[bands, 1, 1] = np.sqrt(sharpness).T
        constant[bands] += (log_i0(sharpness) - sharpness + LOG_TURN).sum(axis=1)
        return whitening, constant

    def residuals(
        self,
        headings: FloatArray,
        jacobians: FloatArray,
        whitening: FloatArray,
        chosen: NDArray[np.intp] | slice = ALL,
    ) -> tuple[FloatArray, FloatArray]:
        """Compare the headings between nodes with components.

        Parameters
        ----------
        headings : ndarray of shape (m, 2)
        jacobians : ndarray of shape (m, 2, 6)
        whitening : ndarray of shape (c, 2, 2)
        chosen : ndarray of shape (k,), int
            Which components; by default all.

        Returns
        -------
        residuals : ndarray of shape (k, 2)
        jacobians : ndarray of shape (k, 2, 6)
        """
        link, frame, root = self.link[chosen], self.frame[chosen], whitening[chosen]
        there = np.einsum("cij,cj->ci", frame, headings[link])
        chord, slope = chords(there - self.mean[chosen])
        inner = slope[:, :, None] * (frame @ jacobians[link])
        return np.einsum("cij,cj->ci", root, chord), root @ inner

    def energies(
        self, headings: FloatArray, whitening: FloatArray, constant: FloatArray
    ) -> FloatArray:
        """Give minus the log of each component's weighted density, of shape (c,)."""
        there = np.einsum("cij,cj->ci", self.frame, headings[self.link])
        chord, _ = chords(there - self.mean)
        residuals = np.einsum("cij,cj->ci", whitening, chord)
        return np.asarray(constant + 0.5 * (residuals**2).sum(axis=1))

    def lowest(self, energies: FloatArray) -> FloatArray:
        """Give the lowest energy of each link, that of nothing being known among them, (m,)."""
        lowest = self.null.copy()
        np.minimum.at(lowest, self.link, energies)
        return lowest

    def shares(self, energies: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Give the probability of each component given the headings.

        Parameters
        ----------
        energies : ndarray of shape (c,)

        Returns
        -------
        shares : ndarray of shape (c,)
            They sum to less than one over a link: the rest is that nothing is known.
        energy : ndarray of shape (m,)
            Minus the log of each link's density.
        """
        lowest = self.lowest(energies)
        relative = np.exp(lowest[self.link] - energies)
        total = np.exp(lowest - self.null)
        np.add.at(total, self.link, relative)
        return relative / total[self.link], lowest - np.log(total)


def mode_covariances(concentrations: FloatArray, couplings: FloatArray) -> FloatArray:
    """Give the covariances of sine models, the inverses of their curvatures, always finite.

    Parameters
    ----------
    concentrations : ndarray of shape (k, 2)
        At least `BROADEST` is taken.
    couplings : ndarray of shape (k,)
        Up to a correlation of `MAX_CORRELATION`.

    Returns
    -------
    ndarray of shape (k, 2, 2)
        Positive definite, radians^2.
    """
    k1, k2 = np.maximum(concentrations, BROADEST).T
    limit = MAX_CORRELATION * np.sqrt(k1 * k2)
    c = np.clip(couplings, -limit, limit)
    entries = np.stack([k2, c, c, k1], axis=-1) / (k1 * k2 - c * c)[:, None]
    return np.asarray(entries.reshape(-1, 2, 2))
