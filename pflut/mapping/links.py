"""What is known about many pairs of images: how probably they are linked, and how they stand."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import checksum, read_arrays, replacing
from pflut.geometry import FloatArray
from pflut.mapping.constraint import KINDS, PoseConstraint
from pflut.von_mises.mixture import VonMisesMixture

LINKED = 0.5
"""Least probability of a pair that counts as linked, where that must be said."""
FORMAT = "pflut links"
VERSION = 1

_OF_PAIRS = (
    "indices",
    "num_matches",
    "log_evidence",
    "probability",
    "kind",
    "entropy",
    "divergence",
    "uniform_weight",
)
_OF_COMPONENTS = ("weights", "means", "concentrations", "couplings")
_OF_BANDS = (
    "rotation_weights",
    "rotation_means",
    "rotation_concentrations",
    "rotation_headings",
    "rotation_heading_concentrations",
)
_TYPES: Mapping[str, type] = {
    "indices": np.int64,
    "num_matches": np.int64,
    "kind": np.uint8,
    "component_offsets": np.int64,
    "band_offsets": np.int64,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Links:
    """Pairs of images, n of them: how probable it is that each is linked, and its constraint.

    Parameters
    ----------
    indices : ndarray of shape (n, 2), int
        Of the images: the reference view L, which is the smaller one, and the query view R.
    num_matches : ndarray of shape (n,), int
    log_evidence : ndarray of shape (n,)
        Of the matches, that the pair is linked, see `LinkEvidence`: at temperature 1.
    probability : ndarray of shape (n,)
        That the pair is linked.
    kind : ndarray of shape (n,), int
        Of the constraint, an index to `pflut.mapping.constraint.KINDS`.
    entropy, divergence : ndarray of shape (n,)
        Of the posterior, and of its mixture's fit, nats.
    component_offsets : ndarray of shape (n + 1,), int
        The mixture of pair i has the components from ``component_offsets[i]`` to
        ``component_offsets[i + 1]``.
    weights, means, concentrations, couplings : ndarray of shape (k,), (k, 2), (k, 2), (k,)
        Of the components of all pairs, see `VonMisesMixture`.
    band_offsets : ndarray of shape (n + 1,), int
        Likewise of the bands of known rotation.
    rotation_weights, rotation_means, rotation_concentrations : ndarray of shape (m,)
        Of the bands of all pairs.
    rotation_headings, rotation_heading_concentrations : ndarray of shape (m,)
        Of the bands along them.
    uniform_weight : ndarray of shape (n,)
        Of what is not known.

    Raises
    ------
    ValueError
        If the shapes do not fit, a value is not finite, an index or a probability is none, or the
        first image of a pair does not come before the second one.
    """

    indices: NDArray[np.int64]
    num_matches: NDArray[np.int64]
    log_evidence: FloatArray
    probability: FloatArray
    kind: NDArray[np.uint8]
    entropy: FloatArray
    divergence: FloatArray
    component_offsets: NDArray[np.int64]
    weights: FloatArray
    means: FloatArray
    concentrations: FloatArray
    couplings: FloatArray
    band_offsets: NDArray[np.int64]
    rotation_weights: FloatArray
    rotation_means: FloatArray
    rotation_concentrations: FloatArray
    rotation_headings: FloatArray
    rotation_heading_concentrations: FloatArray
    uniform_weight: FloatArray

    def __post_init__(self) -> None:
        for item in fields(self):
            dtype = _TYPES.get(item.name, np.float64)
            array: NDArray[Any] = np.ascontiguousarray(getattr(self, item.name), dtype=dtype)
            object.__setattr__(self, item.name, array)
        n, k, m = len(self.indices), len(self.weights), len(self.rotation_weights)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(_OF_PAIRS, (n,))
        shapes |= dict.fromkeys(_OF_COMPONENTS, (k,)) | dict.fromkeys(_OF_BANDS, (m,))
        shapes |= {"indices": (n, 2), "means": (k, 2), "concentrations": (k, 2)}
        shapes |= {"component_offsets": (n + 1,), "band_offsets": (n + 1,)}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name}: a value is not finite")
        for name, size in (("component_offsets", k), ("band_offsets", m)):
            offsets = getattr(self, name)
            if offsets[0] != 0 or offsets[-1] != size or (np.diff(offsets) < 0).any():
                raise ValueError(f"{name}: expected numbers that rise from 0 to {size}")
        if n and (self.indices[:, 0].min() < 0 or (np.diff(self.indices) <= 0).any()):
            raise ValueError("indices: expected two images a pair, the smaller index first")
        if ((self.probability < 0.0) | (self.probability > 1.0)).any():
            raise ValueError("probability: expected numbers in [0, 1]")
        if n and self.kind.max() >= len(KINDS):
            raise ValueError(f"kind: expected numbers below {len(KINDS)}, got {self.kind.max()}")

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.indices)

    @property
    def says_something(self) -> NDArray[np.bool_]:
        """Which constraints say something by themselves, of shape (n,): all but the kind "none"."""
        return np.asarray(self.kind != KINDS.index("none"))

    def __getitem__(self, index: slice | NDArray[Any]) -> Links:
        """Select pairs by a slice, an index array or a mask."""
        chosen = np.arange(len(self))[index]
        arrays: dict[str, NDArray[Any]] = {name: getattr(self, name)[chosen] for name in _OF_PAIRS}
        for offsets, names in (("component_offsets", _OF_COMPONENTS), ("band_offsets", _OF_BANDS)):
            rows, arrays[offsets] = _rows(getattr(self, offsets), chosen)
            arrays |= {name: getattr(self, name)[rows] for name in names}
        return Links(**arrays)

    @classmethod
    def of(
        cls,
        indices: NDArray[np.integer],
        num_matches: Sequence[int] | NDArray[np.integer],
        log_evidence: Sequence[float] | FloatArray,
        probability: Sequence[float] | FloatArray,
        constraints: Sequence[PoseConstraint],
    ) -> Links:
        """Put pairs and their constraints together.

        Parameters
        ----------
        indices : ndarray of shape (n, 2), int
        num_matches, log_evidence, probability : sequence of n numbers
        constraints : sequence of n PoseConstraint

        Returns
        -------
        Links
        """
        mixtures = [constraint.mixture for constraint in constraints]
        joined = {
            name: np.concatenate([getattr(mixture, name) for mixture in mixtures])
            if mixtures
            else np.empty((0, 2) if name in ("means", "concentrations") else 0)
            for name in (*_OF_COMPONENTS, *_OF_BANDS)
        }
        return cls(
            indices=np.reshape(indices, (-1, 2)),
            num_matches=np.asarray(num_matches),
            log_evidence=np.asarray(log_evidence),
            probability=np.asarray(probability),
            kind=np.array([KINDS.index(constraint.kind) for constraint in constraints]),
            entropy=np.array([constraint.entropy for constraint in constraints]),
            divergence=np.array([constraint.divergence for constraint in constraints]),
            component_offsets=_offsets([len(mixture.weights) for mixture in mixtures]),
            band_offsets=_offsets([len(mixture.rotation_weights) for mixture in mixtures]),
            uniform_weight=np.array([mixture.uniform_weight for mixture in mixtures]),
            **joined,
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Links]) -> Links:
        """Put several sets of pairs into one, in their order.

        Parameters
        ----------
        parts : sequence of Links

        Returns
        -------
        Links
        """
        if not parts:
            return cls.of(np.empty((0, 2), np.int64), [], [], [], [])
        arrays: dict[str, NDArray[Any]] = {}
        for item in fields(cls):
            columns = [getattr(part, item.name) for part in parts]
            if item.name.endswith("offsets"):
                arrays[item.name] = _offsets(np.concatenate([np.diff(c) for c in columns]))
            else:
                arrays[item.name] = np.concatenate(columns)
        return cls(**arrays)

    def ordered(self) -> Links:
        """Return the same pairs in the order of their images."""
        return self[np.lexsort((self.indices[:, 1], self.indices[:, 0]))]

    def mixture(self, pair: int) -> VonMisesMixture:
        """Give the mixture of a pair's constraint.

        Parameters
        ----------
        pair : int
            Its number among these, from 0.

        Returns
        -------
        VonMisesMixture
        """
        components = slice(*self.component_offsets[pair : pair + 2])
        bands = slice(*self.band_offsets[pair : pair + 2])
        arrays = {name: getattr(self, name)[components] for name in _OF_COMPONENTS}
        arrays |= {name: getattr(self, name)[bands] for name in _OF_BANDS}
        return VonMisesMixture(**arrays, uniform_weight=float(self.uniform_weight[pair]))

    def constraint(self, pair: int) -> PoseConstraint:
        """Give a pair's constraint.

        Parameters
        ----------
        pair : int
            Its number among these, from 0.

        Returns
        -------
        PoseConstraint
        """
        return PoseConstraint(
            kind=KINDS[self.kind[pair]],
            mixture=self.mixture(pair),
            entropy=float(self.entropy[pair]),
            divergence=float(self.divergence[pair]),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the links to a `.npz` file without pickle, atomically.

        The same links give the same bytes.

        Parameters
        ----------
        path : path
        """
        arrays = {item.name: getattr(self, item.name) for item in fields(self)}
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(
                file,
                format=np.array(FORMAT),
                version=np.array(VERSION),
                checksum=np.array(checksum(FORMAT, arrays)),
                **arrays,
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Links:
        """Read what `save` wrote.

        Parameters
        ----------
        path : path

        Returns
        -------
        Links

        Raises
        ------
        ValueError
            If the file is none, of another version, or damaged.
        FileNotFoundError
            If there is no such file.
        """
        stored = read_arrays(path, "file of links")
        if str(stored.get("format")) != FORMAT:
            raise ValueError(f"{path}: not a file of links of pflut")
        if str(stored.get("version")) != str(VERSION):
            raise ValueError(f"{path}: links version {stored.get('version')}, expected {VERSION}")
        names = [item.name for item in fields(cls)]
        missing = {"checksum", *names} - stored.keys()
        if missing:
            raise ValueError(f"{path}: damaged links, without {', '.join(sorted(missing))}")
        arrays = {name: stored[name] for name in names}
        if str(stored["checksum"]) != checksum(FORMAT, arrays):
            raise ValueError(f"{path}: checksum does not match, the file is damaged")
        try:
            return cls(**arrays)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


def _offsets(counts: Sequence[int] | NDArray[np.integer]) -> NDArray[np.int64]:
    """Give where each of some runs of so many rows begins, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def _rows(
    offsets: NDArray[np.int64], chosen: NDArray[np.intp]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give the rows of some runs, one run after the other, and their new offsets."""
    counts = np.diff(offsets)[chosen]
    begins = _offsets(counts)
    shift = np.repeat(offsets[chosen] - begins[:-1], counts)
    return np.arange(begins[-1]) + shift, begins
