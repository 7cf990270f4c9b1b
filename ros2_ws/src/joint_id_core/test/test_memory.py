"""The memory of the online identifier on Gaussian data: sums of information, false alarms, and what a change is."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.online.memory import HISTORY, LEARNED, RARE, Memory
from joint_id_core.online.piece import Piece, Samples, State

K = 4
SPREAD = np.full(K, 10.0)
BLOCK_S = 0.5


def block(rng, truth, at: float) -> Piece:
    """A block of linear observations of `truth` (K,) with unit noise."""
    s = rng.standard_normal((50, K)) @ np.diag([3.0, 1.0, 1.0, 0.3])
    e = s @ truth + rng.standard_normal(50)
    begin = State(np.zeros((1, 1)), at, np.zeros(1))
    samples = Samples(np.array([at + BLOCK_S]), np.zeros((1, 1)), np.zeros((1, 1)))
    return Piece(s.T @ s, s.T @ e, np.zeros((1, 1)), begin, samples, np.zeros(K), 1.0, np.ones(1))


def run(seed, blocks, change=None, at=None, memory_s=1e9):
    rng = np.random.default_rng(seed)
    truth = np.zeros(K)
    memory = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
    for k in range(blocks):
        memory.add(block(rng, truth if at is None or k < at else truth + change, k * BLOCK_S), memory_s)
        found = memory.test()
        if found is not None:
            return k, found, memory
    return None, None, memory


def test_it_is_least_squares_of_all_blocks():
    rng = np.random.default_rng(0)
    memory = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
    blocks = [block(rng, np.arange(K), 0.5 * k) for k in range(20)]
    for piece in blocks:
        memory.add(piece, 1e9)
    H = np.diag(SPREAD**-2.0) + sum(p.matrix for p in blocks)
    np.testing.assert_allclose(memory.mean, np.linalg.solve(H, sum(p.vector for p in blocks)), rtol=1e-6)
    np.testing.assert_allclose(memory.covariance, np.linalg.inv(H), rtol=1e-6)


def test_forgetting_has_the_variance_of_a_weighted_mean():
    """Weights that fall exponentially: the estimate scatters as its covariance says, not as the sum of weights."""
    ends = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        memory = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
        for k in range(60):
            memory.add(block(rng, np.zeros(K), k * BLOCK_S), 5.0)
        ends.append(memory.mean / np.sqrt(np.diag(memory.covariance)))
    rms = np.sqrt(np.mean(np.square(ends), axis=0))
    np.testing.assert_allclose(rms, 1.0, atol=0.2)


@pytest.mark.parametrize("blocks", [40, HISTORY + 60])
def test_its_blocks_and_what_was_known_before_them_give_its_estimate(blocks):
    """As far as either is forgotten: else blocks that pass the filter again would settle at other values."""
    rng, memory_s = np.random.default_rng(3), 20.0
    memory = Memory(np.full(K, 0.5), np.diag(np.full(K, 0.05**2)), SPREAD)
    for k in range(blocks):
        memory.add(block(rng, np.zeros(K), k * BLOCK_S), memory_s)
    mean, precision = memory.before(memory_s)
    weighted = list(zip(memory.weights(memory_s), memory.blocks, strict=True))
    H = precision + sum(w * piece.matrix for w, piece in weighted)
    h = precision @ mean + sum(w * piece.vector for w, piece in weighted)
    np.testing.assert_allclose(memory.matrix, H, rtol=1e-9, atol=1e-9)
    away = np.linalg.solve(H, h) - memory.mean
    assert np.all(np.abs(away) < 1e-3 * np.sqrt(np.diag(memory.covariance)))


@pytest.mark.long
def test_false_alarms_are_as_rare_as_stated():
    """Each test alarms with probability `RARE` or a few times that: none in 4,000 blocks."""
    assert RARE <= 1e-6
    for seed in range(10):
        assert run(seed, 400)[0] is None


@pytest.mark.parametrize("j", range(K))
def test_a_change_is_found_and_named(j):
    change = np.zeros(K)
    change[j] = 12.0 / np.sqrt(50.0) / [3.0, 1.0, 1.0, 0.3][j]
    k, found, memory = run(1, 100, change, at=60)
    assert k in (60, 61)
    assert found.names[0] == j
    assert len(found.blocks) <= 2
    memory.drop(len(found.blocks))
    mean, precision = found.still_known(SPREAD)
    sigma = np.sqrt(np.diag(np.linalg.inv(precision)))
    assert sigma[j] > 5.0
    assert all(sigma[i] < 1.0 for i in range(K) if i != j and i not in found.likely)
    np.testing.assert_allclose(mean, memory.mean, atol=1e-6)


def test_a_small_change_is_found_later():
    change = np.array([0.0, 3.0 / np.sqrt(50.0), 0.0, 0.0])
    k, found, _ = run(2, 200, change, at=60)
    assert k is not None and 61 < k < 80
    assert 1 in found.names


def with_doubt(memory):
    """Standard deviations that are published."""
    return np.sqrt(np.diag(memory.covariance + memory.doubt))


def test_a_change_that_takes_long_to_find_is_in_the_interval_before():
    """A change of 7 standard deviations of what 30 s told: the test finds it after as long a time again."""
    longest = {"without": [], "with": []}
    for seed in range(12):
        rng, truth = np.random.default_rng(seed), np.zeros(K)
        memory, rows = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD), {"without": [], "with": []}
        for k in range(120):
            if k == 60:
                truth[3] = 7.0 * np.sqrt(memory.covariance[3, 3])
            memory.add(block(rng, truth, k * BLOCK_S), 1e9)
            if memory.test() is not None:
                break
            for name, sigma in (("without", np.sqrt(np.diag(memory.covariance))), ("with", with_doubt(memory))):
                wrong = abs(memory.mean[3] - truth[3]) > 4.0 * sigma[3]
                rows[name].append(rows[name][-1] + 1 if wrong and rows[name] else int(wrong))
        for name, row in rows.items():
            longest[name].append(max(row))
    assert np.median(longest["without"]) > 40
    assert np.median(longest["with"]) < 0.6 * np.median(longest["without"])


@pytest.mark.long
def test_a_slow_drift_is_found_and_learned_from_the_newest_blocks():
    """An estimate that stays six standard deviations behind: 16 s show 2.3 of them, 64 s show 5.4."""
    memory_s, found, wrong = 60.0, [], []
    lag = 6.0 / np.sqrt(50.0 * 2.0 * memory_s / BLOCK_S)  # what the weighted mean is behind once it is steady
    drift = np.array([0.0, lag * BLOCK_S / memory_s, 0.0, 0.0])
    for seed in range(10):
        rng, memory = np.random.default_rng(seed), Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
        for k in range(800):
            memory.add(block(rng, k * drift, k * BLOCK_S), memory_s)
            change = memory.test()
            if change is not None:
                found.append(change)
                break
            off = np.abs(memory.mean - k * drift) / with_doubt(memory)
            wrong.append(off.max() > 4.0)
    assert len(found) > 8
    assert all(change.names[0] == 1 and len(change.blocks) == LEARNED for change in found)
    assert np.mean(wrong) < 0.1


def test_without_a_change_there_is_hardly_ever_a_doubt():
    wider = []
    for seed in range(20):
        rng, memory = np.random.default_rng(seed), Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
        for k in range(60):
            memory.add(block(rng, np.zeros(K), k * BLOCK_S), 1e9)
            assert memory.test() is None
            wider.append(np.max(with_doubt(memory) / np.sqrt(np.diag(memory.covariance))))
    assert np.mean(np.array(wider) > 1.1) < 0.05
    assert np.mean(wider) < 1.05


def test_a_change_in_the_newest_second_is_in_the_interval_before_it_is_found():
    """A second that differs by 4.6 of its standard deviations is no change for sure, but too likely to be left out."""
    off = {"without": [], "with": []}
    for seed in range(20):
        rng, memory = np.random.default_rng(seed), Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
        for k in range(60):
            memory.add(block(rng, np.zeros(K), k * BLOCK_S), 1e9)
            assert memory.test() is None
        truth = np.zeros(K)
        truth[3] = 4.6 * np.sqrt(0.5 * np.linalg.inv(memory.newest.matrix)[3, 3])
        for k in (60, 61):
            memory.add(block(rng, truth, k * BLOCK_S), 1e9)
        if memory.test() is None:
            for name, sigma in (("without", np.sqrt(np.diag(memory.covariance))), ("with", with_doubt(memory))):
                off[name].append(abs(memory.mean[3] - truth[3]) / sigma[3])
    assert len(off["with"]) > 10
    assert np.min(off["without"]) > 10.0
    assert np.median(off["with"]) < 4.0


def test_scatter_beyond_the_noise_widens():
    rng = np.random.default_rng(3)
    memory = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
    for k in range(400):
        piece = block(rng, 0.15 * rng.standard_normal(K) * [1.0, 0.0, 0.0, 0.0], k * BLOCK_S)
        memory.add(piece, 1e9)
        memory.test()
    assert memory.wider[0] > 1.5
    assert np.all(memory.wider[1:] < 1.4)


def test_a_small_change_is_none_where_noise_levels_are_hardly_known():
    """Twice the noise looks like a change of every parameter to one who takes the level for known."""
    change = np.array([0.0, 1.0, 0.0, 0.0])
    rng = np.random.default_rng(3)
    blocks = [block(rng, np.zeros(K), k * BLOCK_S) for k in range(8)]
    blocks.append(block(rng, change, 8 * BLOCK_S))
    found = []
    for tails in (None, np.ones(K), np.full(K, 2.5)):
        memory = Memory(np.zeros(K), np.diag(SPREAD**2), SPREAD)
        memory.allow(tails)
        for piece in blocks:
            memory.add(piece, 1e9)
        found.append(memory.test() is not None)
    assert found == [True, True, False]
