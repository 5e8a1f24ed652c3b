"""One pair: what its link says, and which pairs say nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from along_a_line import (
    COUNT,
    PAIRS,
)

from pflut.features import Features, match
from pflut.likelihood.table import LikelihoodTable
from pflut.mapping.constraint import KINDS, extract_constraint
from pflut.mapping.feature_blocks import FeatureBlock
from pflut.mapping.link_evidence import link_evidence
from pflut.mapping.link_model import LinkModel
from pflut.mapping.links import Links
from pflut.mapping.pair_linker import LinkOptions
from pflut.mapping.proposals import all_of
from pflut.posterior import pose_posterior


def test_a_link_is_what_the_two_images_say(
    features: list[Features],
    small_table: LikelihoodTable,
    link: Callable[..., Links],
    tmp_path: Path,
) -> None:
    links = link(tmp_path)
    assert links.indices.tolist() == all_of(COUNT).tolist()
    block = FeatureBlock.of(features)
    for number in (20, 50, PAIRS - 1):
        left, right = links.indices[number]
        matches = match(block.image(left), block.image(right), mutual=True)
        assert links.num_matches[number] == len(matches)
        posterior = pose_posterior(matches, small_table, temperature=0.3)
        constraint, wanted = links.constraint(number), extract_constraint(posterior)
        evidence = link_evidence([matches], small_table)
        assert links.log_evidence[number] == evidence.log_evidence[0]
        assert links.probability[number] == LinkModel.default().probability(evidence)[0]
        assert constraint.kind == wanted.kind and constraint.entropy == wanted.entropy
        assert np.array_equal(constraint.mixture.means, wanted.mixture.means)


def test_images_of_two_rooms_are_not_linked(link: Callable[..., Links], tmp_path: Path) -> None:
    links = link(tmp_path)
    stranger = (links.indices == 0).any(axis=1)
    near = np.diff(links.indices)[:, 0] == 1
    assert links.probability[stranger].max() < 0.2
    assert links.probability[near & ~stranger].min() > 0.8


def test_few_matches_say_nothing(
    features: list[Features],
    small_table: LikelihoodTable,
    link: Callable[..., Links],
    tmp_path: Path,
) -> None:
    few = [features[0], features[5], features[6], features[7][:0], features[8][:1]]
    links = link(tmp_path, features=few, options=LinkOptions(min_matches=30))
    said = links.num_matches >= 30
    assert said.tolist() == [pair == [1, 2] for pair in links.indices.tolist()]
    assert {KINDS[kind] for kind in links.kind[~said]} == {"none"}
    assert links.constraint(0).mixture.uniform_weight == 1.0
    empty = (links.indices == 3).any(axis=1)
    assert (links.num_matches[empty] == 0).all() and (links.log_evidence[empty] == 0.0).all()
    assert links.probability[empty].max() < links.probability[said].min()


def test_what_is_not_linked_says_nothing(link: Callable[..., Links], tmp_path: Path) -> None:
    asked = link(tmp_path / "asked", options=LinkOptions(min_probability=0.0))
    least = float(np.median(asked.probability))
    said = link(tmp_path / "said", options=LinkOptions(min_probability=least))
    assert np.array_equal(asked.probability, said.probability)
    none = KINDS.index("none")
    assert (said.kind[said.probability < least] == none).all()
    near = said.probability >= least
    assert np.array_equal(said.entropy[near], asked.entropy[near])
    assert 0 < near.sum() < (asked.kind != none).sum()


def test_a_prior_moves_the_probability(link: Callable[..., Links], tmp_path: Path) -> None:
    odds = []
    for prior in (None, 0.01):
        links = link(tmp_path / str(prior), options=LinkOptions(prior=prior))
        odds.append(np.log(links.probability / (1.0 - links.probability))[:30])
    expected = np.log(0.01 / 0.99) + np.log(1.0 / LinkModel.default().prior - 1.0)
    assert odds[1] - odds[0] == pytest.approx(np.full(30, expected), abs=1e-6)


def test_options_out_of_range() -> None:
    for name, values in (
        ("ratio", (0.0, 1.1)),
        ("min_matches", (0,)),
        ("min_probability", (-0.1, 1.1)),
        ("temperature", (0.0,)),
        ("prior", (0.0, 1.0)),
    ):
        for value in values:
            with pytest.raises(ValueError, match=f"^{name}: expected .*got {value}"):
                LinkOptions(**{name: value})
