"""Visual words: alike images have alike signatures, reproducibly."""

from __future__ import annotations

import numpy as np
import pytest

from pflut.retrieval import MAX_TRAINING, WORDS, Gallery, Vocabulary


def images(n: int, seed: int, *, size: int = 40, binary: bool = False) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    if binary:
        return [rng.integers(0, 256, (size, 32), dtype=np.uint8) for _ in range(n)]
    out = []
    for _ in range(n):
        d = rng.normal(size=(size, 64)).astype(np.float32)
        out.append(d / np.linalg.norm(d, axis=1, keepdims=True))
    return out


def naive_signature(words: np.ndarray, descriptors: np.ndarray) -> np.ndarray:
    sums = np.zeros(words.shape)
    for d in descriptors.astype(float):
        nearest = int(np.argmin([np.linalg.norm(d - w) for w in words]))
        sums[nearest] += d - words[nearest]
    for row in sums:
        if row.any():
            row /= np.linalg.norm(row)
    return sums.ravel() / np.linalg.norm(sums)


@pytest.mark.parametrize("binary", [False, True])
def test_signature_equals_its_naive_twin(binary: bool) -> None:
    some = images(6, 0, binary=binary)
    vocabulary = Vocabulary.learn(some, words=8)
    for d in some:
        bits = np.unpackbits(d, axis=1) if binary else d
        expected = naive_signature(vocabulary.words, bits)
        assert vocabulary.signature(d) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("binary", [False, True])
def test_the_most_similar_image_is_the_one_with_shared_features(binary: bool) -> None:
    some, noise = images(20, 1, binary=binary), images(20, 2, binary=binary)
    gallery = Gallery.learn(some)
    odd = gallery[np.arange(1, 20, 2)]
    for i in range(20):
        # a third of what was seen before, and as much again that was not
        query = np.concatenate([some[i][:14], noise[i][:26]])
        similar = gallery.similarity(query)
        assert similar.shape == (20,) and np.argmax(similar) == i
        assert odd.similarity(query) == pytest.approx(similar[1::2], abs=1e-6)
    assert not gallery.similarity(some[0][:0]).any()


def test_the_order_of_features_does_not_matter() -> None:
    some = images(5, 3)
    vocabulary = Vocabulary.learn(some)
    assert vocabulary.signature(some[0][::-1]) == pytest.approx(
        vocabulary.signature(some[0]), abs=1e-5
    )


def test_learning_is_reproducible() -> None:
    some = images(10, 4)
    first, again, other = (Vocabulary.learn(some, seed=s).words for s in (0, 0, 1))
    assert (first == again).all()
    assert (first != other).any()
    # a large set is sampled
    large = [np.repeat(some[0], MAX_TRAINING // 20, axis=0)]
    assert np.isfinite(Vocabulary.learn(large, words=4).words).all()


def test_few_features_and_none() -> None:
    some = images(2, 5, size=5)
    assert Vocabulary.learn(some).words.shape == (10, 64)
    assert Vocabulary.learn(images(9, 5)).words.shape == (WORDS, 64)
    for rows in ([some[0][:1]], [some[0][:0]], [some[0][:0], some[0][:0]]):
        vocabulary = Vocabulary.learn(rows)
        assert vocabulary.words.shape == (1, 64)
        signature = vocabulary.signature(some[1])
        assert np.linalg.norm(signature) == pytest.approx(1.0)
    assert not vocabulary.signature(some[0][:0]).any()


def test_identical_features_give_finite_signatures() -> None:
    same = [np.tile(images(1, 6)[0][:1], (50, 1))] * 3
    vocabulary = Vocabulary.learn(same)
    assert np.isfinite(vocabulary.words).all()
    assert np.isfinite(vocabulary.signature(same[0])).all()
