"""Residuals of pose graphs: derivatives against differences, densities against mixtures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from graphs import links_of
from test_links import random_links

from pflut.geometry import FloatArray, relative_headings, wrap_to_2pi
from pflut.mapping.graph_residuals import chords, headings, odometry_residuals
from pflut.mapping.link_terms import LinkTerms
from pflut.von_mises.mixture import VonMisesMixture

STEP = 1e-6


def differences(function: Callable[[FloatArray], FloatArray], poses: FloatArray) -> FloatArray:
    """Derivatives of a function of two poses by central differences, (..., 6)."""
    columns = []
    for k in range(6):
        step = np.zeros(6)
        step[k] = STEP
        up, down = (function(poses + sign * step.reshape(2, 3)) for sign in (1, -1))
        columns.append((up - down) / (2.0 * STEP))
    return np.stack(columns, axis=-1)


def test_derivatives_of_odometry() -> None:
    rng = np.random.default_rng(0)
    ends = np.array([[0, 1]])
    for _ in range(20):
        poses, motion = rng.normal(size=(2, 3)), rng.normal(size=(1, 3))
        _, jacobian = odometry_residuals(poses, ends, motion)
        expected = differences(lambda p, m=motion: odometry_residuals(p, ends, m)[0][0], poses)
        np.testing.assert_allclose(jacobian[0], expected, atol=1e-7)


def test_headings_are_those_of_the_geometry_and_so_are_their_derivatives() -> None:
    rng = np.random.default_rng(1)
    ends = np.array([[0, 1]])
    for _ in range(20):
        poses = rng.normal(size=(2, 3))
        values, jacobian = headings(poses, ends)
        theta, phi, _ = relative_headings(*poses)
        np.testing.assert_allclose(wrap_to_2pi(values[0]), [theta, phi], atol=1e-12)
        expected = differences(lambda p: headings(p, ends)[0][0], poses)
        np.testing.assert_allclose(jacobian[0], expected, atol=1e-5)


def test_nodes_of_one_place_have_finite_derivatives() -> None:
    _, jacobian = headings(np.zeros((2, 3)), np.array([[0, 1]]))
    assert np.isfinite(jacobian).all()


def test_a_chord_is_a_von_mises_distribution() -> None:
    angles = np.linspace(-9.0, 9.0, 41)
    chord, slope = chords(angles)
    np.testing.assert_allclose(0.5 * chord**2, 1.0 - np.cos(angles), atol=1e-12)
    np.testing.assert_allclose(chord * slope, np.sin(angles), atol=1e-12)


def test_derivatives_of_components() -> None:
    links, _ = random_links(30, 3)
    terms = LinkTerms.of(links)
    whitening, _ = terms.whitened(np.tile(0.01 * np.eye(2), (len(links), 1, 1)))
    rng = np.random.default_rng(2)
    poses = rng.normal(size=(2, 3))
    ends = np.tile([0, 1], (len(links), 1))

    def residuals(p: FloatArray) -> FloatArray:
        values, jacobians = headings(p, ends)
        return terms.residuals(values, jacobians, whitening)[0]

    _, jacobian = terms.residuals(*headings(poses, ends), whitening)
    expected = differences(residuals, poses)
    # where an angle is opposite to a mean the chord turns over
    smooth = np.abs(expected).max(axis=(1, 2)) < 1e3
    assert smooth.mean() > 0.9
    np.testing.assert_allclose(jacobian[smooth], expected[smooth], atol=1e-4, rtol=1e-4)


def sharp_mixture() -> VonMisesMixture:
    return VonMisesMixture(
        weights=np.array([0.5, 0.2]),
        means=np.array([[0.3, 2.0], [-1.0, 3.0]]),
        concentrations=np.array([[4e4, 1e4], [2e4, 2e4]]),
        couplings=np.array([9e3, -5e3]),
        rotation_weights=np.array([0.2]),
        rotation_means=np.array([1.2]),
        rotation_concentrations=np.array([7.0]),
        uniform_weight=0.1,
        rotation_headings=np.array([0.4]),
        rotation_heading_concentrations=np.array([0.5]),
    )


def test_energies_are_the_mixtures_own_where_no_noise_is_added() -> None:
    mixture = sharp_mixture()
    links = links_of(np.array([[0, 1]]), [mixture], probability=0.7)
    terms = LinkTerms.of(links)
    whitening, constant = terms.whitened(np.zeros((1, 2, 2)))
    rng = np.random.default_rng(4)
    for offset in rng.normal(0.0, 0.01, (20, 2)):
        there = np.array([[0.3, 2.0]]) + offset
        logs = mixture.component_log_densities(there[0])
        energies = terms.energies(there, whitening, constant)
        near = [0, 2]  # the first mode, and the band: of a far mode only the size matters
        np.testing.assert_allclose(energies[near], -logs[near] - np.log(0.7), rtol=2e-3, atol=2e-3)
        assert energies[1] > 100.0 and -logs[1] > 100.0
        null = 0.7 * np.exp(logs[3]) + 0.3 / (2.0 * np.pi) ** 2
        np.testing.assert_allclose(terms.null[0], -np.log(null), rtol=1e-12)
        shares, energy = terms.shares(energies)
        density = 0.7 * np.exp(mixture.log_density(there[0])) + 0.3 / (2.0 * np.pi) ** 2
        np.testing.assert_allclose(energy[0], -np.log(density), atol=3e-3)
        assert terms.lowest(energies)[0] == min(energies.min(), terms.null[0])
        np.testing.assert_allclose(shares.sum(), 1.0 - np.exp(energy[0] - terms.null[0]))


def test_noise_makes_components_broad() -> None:
    links = links_of(np.array([[0, 1]]), [sharp_mixture()])
    terms = LinkTerms.of(links)
    noise = np.array([[[0.5, 0.1], [0.1, 0.3]]])
    whitening, _ = terms.whitened(noise)
    covariance = np.linalg.inv(whitening[0].T @ whitening[0])
    np.testing.assert_allclose(covariance, terms.covariance[0] + noise[0], rtol=1e-9)
    # a band's first number is the rotation, whose variance grows by that of a difference
    variance = 1.0 / whitening[2, 0, 0] ** 2
    np.testing.assert_allclose(variance, 1.0 / 7.0 + 0.5 + 0.3 - 0.2, rtol=1e-9)


def test_a_band_of_all_headings_says_nothing_of_them() -> None:
    mixture = VonMisesMixture(
        rotation_weights=np.ones(1),
        rotation_means=np.array([0.5]),
        rotation_concentrations=np.array([400.0]),
    )
    terms = LinkTerms.of(links_of(np.array([[0, 1]]), [mixture]))
    whitening, constant = terms.whitened(np.tile(1e-4 * np.eye(2), (1, 1, 1)))
    assert whitening[0, 1, 1] == 0.0
    along = [
        terms.energies(np.array([[a, a + np.pi - 0.5]]), whitening, constant)[0]
        for a in (0.0, 1.0, 3.0)
    ]
    np.testing.assert_allclose(along, along[0], rtol=1e-12)
