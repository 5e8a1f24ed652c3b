"""Links: pairs of images with their constraints as arrays, and their file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pflut.mapping.constraint import KINDS, PoseConstraint
from pflut.mapping.links import Links
from pflut.von_mises.mixture import VonMisesMixture


def random_constraint(rng: np.random.Generator) -> PoseConstraint:
    """A constraint with up to three modes and up to two bands."""
    modes, bands = rng.integers(0, 4), rng.integers(0, 3)
    weights = rng.uniform(0.1, 1.0, modes + bands + 1)
    weights /= weights.sum()
    mixture = VonMisesMixture(
        weights=weights[:modes],
        means=rng.uniform(-3.0, 3.0, (modes, 2)),
        concentrations=rng.uniform(1.0, 50.0, (modes, 2)),
        couplings=rng.uniform(-0.9, 0.9, modes),
        rotation_weights=weights[modes:-1],
        rotation_means=rng.uniform(-3.0, 3.0, bands),
        rotation_concentrations=rng.uniform(0.0, 50.0, bands),
        uniform_weight=float(weights[-1]),
        rotation_headings=rng.uniform(-3.0, 3.0, bands),
        rotation_heading_concentrations=rng.uniform(0.0, 5.0, bands),
    )
    return PoseConstraint(str(rng.choice(KINDS)), mixture, *rng.uniform(0.0, 4.0, 2))


def random_links(count: int, seed: int = 0) -> tuple[Links, list[PoseConstraint]]:
    """Pairs of random images, those with the numbers of a triangle, and their constraints."""
    rng = np.random.default_rng(seed)
    constraints = [random_constraint(rng) for _ in range(count)]
    every = np.column_stack(np.triu_indices(40, 1))
    indices = every[rng.choice(len(every), count, replace=False)]
    links = Links.of(
        indices,
        rng.integers(0, 99, count),
        rng.normal(0.0, 9.0, count),
        rng.uniform(size=count),
        constraints,
    )
    return links, constraints


def arrays(links: Links) -> dict[str, np.ndarray]:
    return {item.name: getattr(links, item.name) for item in fields(links)}


def same(a: Links, b: Links) -> bool:
    return all(np.array_equal(value, arrays(b)[name]) for name, value in arrays(a).items())


def equal(a: PoseConstraint, b: PoseConstraint) -> bool:
    """Whether two constraints are the same, number by number."""
    alone = (a.kind, a.entropy, a.divergence) == (b.kind, b.entropy, b.divergence)
    return alone and all(
        np.array_equal(getattr(a.mixture, item.name), getattr(b.mixture, item.name))
        for item in fields(VonMisesMixture)
    )


def test_every_field_of_a_mixture_is_kept() -> None:
    assert {item.name for item in fields(VonMisesMixture)} <= {item.name for item in fields(Links)}


def test_constraints_come_back() -> None:
    links, constraints = random_links(30)
    assert len(links) == 30 and {c.kind for c in constraints} == set(KINDS)
    assert all(equal(links.constraint(i), c) for i, c in enumerate(constraints))


@pytest.mark.parametrize("index", [slice(3, 19, 2), np.array([5, 0, 29, 5]), slice(0, 0)])
def test_some_of_the_pairs(index: Any) -> None:
    links, constraints = random_links(30)
    some = links[index]
    chosen = np.arange(30)[index]
    assert len(some) == len(chosen)
    assert np.array_equal(some.indices, links.indices[chosen])
    for number, before in enumerate(chosen):
        assert equal(some.constraint(number), constraints[before])
    assert same(links[links.probability >= 0.0], links)


def test_parts_make_the_whole_again() -> None:
    links, _ = random_links(30)
    assert same(Links.concatenate([links[:7], links[7:7], links[7:]]), links)
    assert len(Links.concatenate([])) == 0


def test_in_the_order_of_their_images() -> None:
    links, constraints = random_links(30)
    ordered = links.ordered()
    assert ordered.indices.tolist() == sorted(links.indices.tolist())
    assert same(ordered[::-1].ordered(), ordered)
    before = links.indices.tolist().index(ordered.indices[4].tolist())
    assert equal(ordered.constraint(4), constraints[before])


def test_the_file(tmp_path: Path) -> None:
    links, _ = random_links(30)
    links.save(tmp_path / "a.npz")
    Links.load(tmp_path / "a.npz").save(tmp_path / "b.npz")
    assert same(Links.load(tmp_path / "b.npz"), links)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    none = Links.concatenate([])
    none.save(tmp_path / "none.npz")
    assert same(Links.load(tmp_path / "none.npz"), none)


def test_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "links.npz"
    links, _ = random_links(5)
    with pytest.raises(FileNotFoundError):
        Links.load(path)
    path.write_bytes(b"PK nothing")
    with pytest.raises(ValueError, match=r"links\.npz: not a file of links of pflut, or damaged"):
        Links.load(path)
    links.save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"links\.npz: not a file of links of pflut, or damaged"):
        Links.load(path)
    np.savez(path, a=np.zeros(1))
    with pytest.raises(ValueError, match=r"links\.npz: not a file of links of pflut$"):
        Links.load(path)
    links.save(path)
    with np.load(path, allow_pickle=False) as file:
        stored = dict(file)
    for change, message in (
        ({"version": np.array(99)}, "links version 99, expected 1"),
        ({"probability": 0.5 * stored["probability"]}, "checksum does not match"),
    ):
        np.savez(path, **{**stored, **change})
        with pytest.raises(ValueError, match=rf"links\.npz: {message}"):
            Links.load(path)
    stored.pop("kind")
    np.savez(path, **stored)
    with pytest.raises(ValueError, match=r"links\.npz: damaged links, without kind"):
        Links.load(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("probability", [0.5, 1.5], r"probability: expected numbers in \[0, 1\]"),
        ("probability", [0.5], r"probability: expected shape \(2,\), got \(1,\)"),
        ("log_evidence", [0.5, np.nan], "log_evidence: a value is not finite"),
        ("indices", [[0, 1], [2, 2]], "indices: expected two images a pair, the smaller"),
        ("indices", [[0, 1], [-1, 2]], "indices: expected two images a pair, the smaller"),
        ("kind", [0, 4], "kind: expected numbers below 4, got 4"),
        ("band_offsets", [0, 1, 1], "band_offsets: expected numbers that rise from 0 to 0"),
        ("component_offsets", [0, 1], r"component_offsets: expected shape \(3,\)"),
    ],
)
def test_what_does_not_fit(name: str, value: Any, message: str) -> None:
    nothing = PoseConstraint("none", VonMisesMixture(uniform_weight=1.0), 3.7, 0.0)
    links = Links.of(np.array([[0, 1], [1, 2]]), [3, 4], [0.0, 1.0], [0.5, 1.0], [nothing] * 2)
    with pytest.raises(ValueError, match=f"^{message}"):
        Links(**{**arrays(links), name: np.array(value)})
