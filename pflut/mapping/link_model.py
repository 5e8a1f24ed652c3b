"""The probability that two images are linked: logistic regression on the evidence."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import as_file, files
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from pflut._files import checksum, read_json, write_json
from pflut.camera.base import Camera
from pflut.geometry import FloatArray
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.link_evidence import DIRECTIONS, LinkEvidence
from pflut.mapping.logistic import fit_logistic, logit, sigmoid

FORMAT = "pflut link model"
VERSION = 1
RIDGE = 1.0
"""Inverse variance of the weights of standardised features, beforehand."""
Name = Literal["panorama", "home", "perspective"]
_OF_TABLES: dict[str, Name] = {"default": "panorama", "home": "home"}
SHIPPED = {name: f"links_{name}.json" for name in ("panorama", "home", "perspective")}

LEAST_ROTATION_STD = 1e-4
"""Radians, well below a pixel: to know a rotation better makes no link more probable."""
# evidence and the number of matches reach from nothing to thousands, and the first of them say
# most: their logarithms are weighed
_FEATURES: dict[str, Callable[[LinkEvidence], FloatArray]] = {
    "log_evidence": lambda evidence: np.arcsinh(evidence.log_evidence),
    "num_matches": lambda evidence: np.log1p(evidence.num_matches),
    "inlier_share": lambda evidence: evidence.num_inliers / np.maximum(evidence.num_matches, 1),
    "num_directions": lambda evidence: evidence.num_directions / DIRECTIONS,
    "spread": lambda evidence: evidence.spread,
    "rotation": lambda evidence: np.cos(evidence.rotation),
    "rotation_std": lambda evidence: np.log(np.maximum(evidence.rotation_std, LEAST_ROTATION_STD)),
}
ALL_AROUND = ("log_evidence", "num_matches", "num_directions")
"""What tells links of panoramas."""
AHEAD = ("log_evidence", "num_matches", "inlier_share", "spread", "rotation", "rotation_std")
"""What tells links of cameras that look ahead: a view that turned shares less with another, and in
how few directions matches agree says little where all of them lie within a few."""


def link_features(evidence: LinkEvidence, names: Sequence[str] = ALL_AROUND) -> FloatArray:
    """Return what a model weighs.

    Parameters
    ----------
    evidence : LinkEvidence
        Of n pairs.
    names : sequence of str
        Of features: ``log_evidence`` and ``num_matches`` (their logarithms), ``inlier_share`` (of
        all matches), ``num_directions`` (of 16), ``spread``, ``rotation`` (its cosine) and
        ``rotation_std`` (its logarithm).

    Returns
    -------
    ndarray of shape (n, len(names))

    Raises
    ------
    ValueError
        If there is no such feature.
    """
    return np.stack([_FEATURES[name](evidence) for name in checked_features(names)], axis=1)


@dataclass(frozen=True, eq=False)
class LinkModel:
    """The probability that two images are linked, given what their matches say.

    The log-odds of a link are a weighted sum of `link_features`; what counts as a link is said in
    `pflut.mapping.true_links`. A probability is for pairs of which a share ``prior`` is linked;
    that of the pairs it was learned from is kept, and another one moves the log-odds.

    Parameters
    ----------
    weights : array_like of shape (len(features),)
        Of the features as they are.
    bias : float
        The log-odds where all features are zero.
    prior : float
        Share in (0, 1) of linked pairs among those it was learned from.
    learned_from : dict
        How it was learned; stored in its file.
    features : sequence of str
        What it weighs, see `link_features`.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range, or there are not as many weights as features,
        or no such features.
    """

    weights: FloatArray
    bias: float
    prior: float
    learned_from: dict[str, Any] = field(default_factory=dict)
    features: tuple[str, ...] = ALL_AROUND

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", checked_features(self.features))
        weights = np.ascontiguousarray(self.weights, dtype=np.float64)
        count = len(self.features)
        if weights.shape != (count,) or not np.isfinite(weights).all():
            raise ValueError(f"weights: expected {count} finite numbers, got {weights}")
        if not np.isfinite(self.bias):
            raise ValueError(f"bias: expected a finite number, got {self.bias}")
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "bias", float(self.bias))
        object.__setattr__(self, "prior", float(checked_prior(self.prior)))

    def log_odds(self, evidence: LinkEvidence, *, prior: float | None = None) -> FloatArray:
        """Compute the log-odds of a link.

        Parameters
        ----------
        evidence : LinkEvidence
            Of n pairs, with the table that the model was learned with.
        prior : float, optional
            Share in (0, 1) of linked pairs among those that are asked about: about one in five of
            all pairs of a home's images, one in thousands of those of a town, most of what a
            retrieval proposes. Default: that of the pairs the model was learned from.

        Returns
        -------
        ndarray of shape (n,)

        Raises
        ------
        ValueError
            If the prior is out of its range.
        """
        # not a matrix product: the same pair has the same odds whatever the others are
        odds = (link_features(evidence, self.features) * self.weights).sum(axis=1) + self.bias
        if prior is not None:
            odds = odds + logit(checked_prior(prior)) - logit(self.prior)
        return np.asarray(odds)

    def probability(self, evidence: LinkEvidence, *, prior: float | None = None) -> FloatArray:
        """Compute the probability of a link.

        Parameters
        ----------
        evidence, prior
            See `log_odds`.

        Returns
        -------
        ndarray of shape (n,)
            In (0, 1).

        Raises
        ------
        ValueError
            If the prior is out of its range.
        """
        return sigmoid(self.log_odds(evidence, prior=prior))

    @classmethod
    def learn(
        cls,
        evidence: LinkEvidence,
        linked: ArrayLike,
        *,
        weights: ArrayLike | None = None,
        learned_from: Mapping[str, Any] | None = None,
        features: Sequence[str] = ALL_AROUND,
    ) -> LinkModel:
        """Learn a model from pairs of which it is known whether they are linked.

        Logistic regression by Newton's method, with a normal prior of variance one on the weights
        of the standardised features: pairs that can be told apart perfectly give finite weights.

        Parameters
        ----------
        evidence : LinkEvidence
            Of n pairs.
        linked : array_like of bool, shape (n,)
            See `pflut.mapping.true_links`; some must be, and some not.
        weights : array_like of shape (n,), optional
            How often each pair counts.
        learned_from : mapping, optional
            JSON-serialisable, kept with the model.
        features : sequence of str
            What it is to weigh: `ALL_AROUND` for panoramas, `AHEAD` for cameras that look ahead, or
            other `link_features`.

        Returns
        -------
        LinkModel

        Raises
        ------
        ValueError
            If the shapes differ, all pairs are linked or none, or there is no such feature.
        """
        yes = np.asarray(linked, dtype=bool)
        times = np.ones(len(evidence)) if weights is None else np.asarray(weights, np.float64)
        if not yes.shape == times.shape == (len(evidence),):
            raise ValueError(
                f"linked, weights: expected shape ({len(evidence)},), got {yes.shape} "
                f"and {times.shape}"
            )
        if not np.isfinite(times).all() or (times < 0.0).any():
            raise ValueError("weights: expected finite numbers that are not negative")
        total = times.sum()
        share = times @ yes / total if total > 0.0 else 0.0
        if not 0.0 < share < 1.0:
            raise ValueError("linked: expected pairs that are, and pairs that are not")
        raw = link_features(evidence, features)
        mean = times @ raw / total
        scale = np.sqrt(times @ (raw - mean) ** 2 / total)
        scale[scale < 1e-9] = 1.0
        columns = np.column_stack([(raw - mean) / scale, np.ones(len(raw))])
        found = fit_logistic(columns, yes, times, ridge=RIDGE)
        slopes = found[:-1] / scale
        about = dict(learned_from or {}) | {"pairs": len(yes), "linked": int(yes.sum())}
        bias = float(found[-1] - slopes @ mean)
        return cls(slopes, bias, float(share), about, tuple(features))

    @classmethod
    def default(cls, name: Name = "panorama") -> LinkModel:
        """Return a model that comes with pflut, learned from rendered homes.

        Parameters
        ----------
        name : {"panorama", "home", "perspective"}
            "panorama" judges evidence of the default table, "home" that of the table for homes,
            both of panoramas; "perspective" that of the default table, of cameras in rooms that see
            some 80 degrees ahead. On a road, where views reach farther than in rooms, that one
            ranks pairs well but is far too sure: `learn` another.

        Returns
        -------
        LinkModel

        Raises
        ------
        ValueError
            If the name is another.
        """
        if name not in SHIPPED:
            raise ValueError(f"name: expected one of {', '.join(SHIPPED)}, got {name!r}")
        with as_file(files("pflut.mapping").joinpath(SHIPPED[name])) as path:
            return cls.load(path)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a JSON file, atomically.

        Parameters
        ----------
        path : path
        """
        content = self._content()
        write_json(path, content | {"checksum": _checksum(content)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LinkModel:
        """Read a model from its file.

        Parameters
        ----------
        path : path

        Returns
        -------
        LinkModel

        Raises
        ------
        ValueError
            If the file is damaged, or of another kind or version.
        FileNotFoundError
            If there is no such file.
        """
        content = read_json(path)
        if content.get("format") != FORMAT:
            raise ValueError(f"{path}: not a {FORMAT}")
        if content.get("version") != VERSION or not _known(content.get("features")):
            raise ValueError(
                f"{path}: link model version {content.get('version')}, expected {VERSION}; "
                "learn it again or upgrade pflut"
            )
        stated = content.pop("checksum", None)
        if stated != _checksum(content):
            raise ValueError(f"{path}: checksum does not match, the file is damaged")
        try:
            names = ("weights", "bias", "prior", "learned_from", "features")
            return cls(*(content[name] for name in names))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: damaged {FORMAT} ({error})") from None

    def _content(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "version": VERSION,
            "features": list(self.features),
            "weights": self.weights.tolist(),
            "bias": self.bias,
            "prior": self.prior,
            "learned_from": self.learned_from,
        }


def link_model_name(table: str, camera: Camera) -> Name | None:
    """Say which model judges evidence of a table and a camera, if one does.

    Parameters
    ----------
    table : str
        Its name: "default" and "home" are judged.
    camera : Camera
        One that looks all around: where others look, in rooms or along a road, it does not tell.

    Returns
    -------
    {"panorama", "home"} or None
    """
    return _OF_TABLES.get(table) if camera.horizontally_periodic else None


def default_link_model(table: LikelihoodTable) -> LinkModel:
    """Give the model that comes with pflut for panoramas and a table.

    Parameters
    ----------
    table : LikelihoodTable
        The default one, or that for homes, whatever its bins.

    Returns
    -------
    LinkModel

    Raises
    ------
    ValueError
        If it is another one.
    """
    names: tuple[Literal["panorama", "home"], ...] = ("panorama", "home")
    for name in names:
        if table.digest == LikelihoodTable.default(name).digest:
            return LinkModel.default(name)
    raise ValueError(
        "link_model: expected one that judges evidence of this table, got none; those for the "
        "default table and for that of homes come with pflut"
    )


def _checksum(content: Mapping[str, Any]) -> str:
    return checksum(json.dumps(content, sort_keys=True), {})


def _known(names: Any) -> bool:
    if not isinstance(names, list) or not names:
        return False
    return all(isinstance(name, str) and name in _FEATURES for name in names)


def checked_features(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of features; raise ValueError if there are none or unknown ones."""
    if not _known(list(names)):
        raise ValueError(f"features: expected some of {', '.join(_FEATURES)}, got {list(names)}")
    return tuple(names)


def checked_prior(prior: float) -> float:
    """Return a share of linked pairs; raise ValueError if it is not in (0, 1)."""
    if not 0.0 < prior < 1.0:
        raise ValueError(f"prior: expected a share in (0, 1), got {prior}")
    return prior
