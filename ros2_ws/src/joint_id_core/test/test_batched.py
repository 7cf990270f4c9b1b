"""The network on tensors against the compiled kernel: the same numbers, for a whole batch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the batched network needs torch, which is not installed")

from joint_id_core.cell.kernel import compile_model  # noqa: E402
from joint_id_core.cell.rollout import rollout_sensitivities  # noqa: E402
from joint_id_core.errors import JointIdError  # noqa: E402
from joint_id_core.estimators.innovations.noise import NoiseLevels  # noqa: E402
from joint_id_core.estimators.innovations.recursion import Recursion  # noqa: E402
from joint_id_core.estimators.many.passes import TorchPasses, record_of  # noqa: E402
from joint_id_core.estimators.shared.fit_data import prepare  # noqa: E402
from joint_id_core.models import MODELS, build  # noqa: E402
from joint_id_core.simulation import simulate_motion  # noqa: E402
from joint_id_core.tensors.filter import InnovationsFilter  # noqa: E402
from joint_id_core.tensors.records import Records  # noqa: E402
from joint_id_core.tensors.rollout import rollout  # noqa: E402
from joint_id_core.tensors.torch_cell import device_of, torch_cell  # noqa: E402

CPU = torch.device("cpu")
CLOSE = 1e-9  # relative to the largest number of an array
CASES = [(name, {}) for name in MODELS] + [("motor_side", {"delays": True}), ("rigid_joint", {"friction": "stribeck"})]
IDS = [f"{name}{'-'.join(map(str, options))}" for name, options in CASES]
MOST = ("rigid_joint", "motor_side")  # those that share least, as they stand; the others in `make test-long`


def quick(*case):
    """A case of a model, marked."""
    return pytest.param(*case, marks=() if case[0] in MOST and not any(case[1:]) else pytest.mark.long)


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Small tensors are slower on several threads, and much slower beside other tests."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def assert_close(found, expected):
    found, expected = np.asarray(found), np.asarray(expected)
    size = np.max(np.abs(expected), initial=0.0)
    assert size > 0.0 and np.max(np.abs(found - expected)) < CLOSE * size, (found, expected)


def problem(name, options, seed, samples=130):
    """A short record with missing labels and a long gap, after which the state starts again."""
    model, rng = build(name, **options), np.random.default_rng(seed)
    data = prepare(model, simulate_motion(build(name), samples / 500.0, 500.0, seed=seed))
    y, gap = data.y.copy(), data.gap.copy()
    y[rng.random(y.shape) < 0.1] = np.nan
    gap[20], gap[40] = 2.0, 10.0
    data = replace(data, y=y, gap=gap)
    assert len(data.starts) and len(data.settling)
    recursion = Recursion(data, compile_model(model, "tanh", data.freed))
    if model.label_delays:
        # The first label of a late sensor takes P0 down to R, 3e9 times less here, by a subtraction: nine digits are
        # lost, in both, and what is known of the noise levels then agrees to 2e-9. A narrower prior keeps them.
        recursion.P0, recursion._V0 = 1e-6 * recursion.P0, 1e-6 * recursion._V0
    return recursion


def points(recursion, count, rng):
    """Random values of the free parameters, and random noise levels."""
    data = recursion.data
    middle = data.p[recursion.index]
    free = middle * np.exp(0.2 * rng.standard_normal((count, len(middle))))
    free += np.where(middle == 0.0, 1e-3, 0.0) * rng.standard_normal((count, len(middle)))
    levels = NoiseLevels.of(data).rough * np.exp(rng.standard_normal((count, len(data.noise_names))))
    return free, levels


@pytest.mark.parametrize(("name", "options"), [quick(*case) for case in CASES], ids=IDS)
def test_a_batch_of_filters_equals_the_compiled_kernel(name, options):
    """Records of different lengths with own integrator steps; every element with own parameters and noise levels."""
    rng = np.random.default_rng(3)
    recursions = [problem(name, options, 1), problem(name, options, 2, samples=100)]
    steps = [rng.integers(1, 4, len(r.data.time)) for r in recursions]
    record = np.array([0, 1, 1])
    free, levels = points(recursions[0], len(record), rng)
    passes = TorchPasses(recursions, steps)
    for b, found in enumerate(passes.run(record, free, levels)):
        recursion = recursions[record[b]]
        expected = recursion.run(free[b], levels[b], steps[record[b]])
        noise = recursion.noise_information(expected, with_parameters=True)
        assert np.isfinite(expected.cost)
        assert_close(found.cost, expected.cost)
        assert_close(found.gradient, expected.gradient)
        assert_close(found.hessian, expected.hessian)
        assert found.noise is not None
        for one, other in zip(found.noise, noise, strict=True):
            assert_close(one, other)


@pytest.mark.parametrize("friction", ["tanh", "sign"])
@pytest.mark.parametrize("name", [quick(name) for name in MODELS])
def test_a_batch_of_simulations_equals_the_compiled_kernel(name, friction):
    recursion, rng = problem(name, {}, 1, samples=60), np.random.default_rng(5)
    data = recursion.data
    kernel = compile_model(data.model, friction, data.freed)
    steps = np.full(len(data.time), 2)
    free, _ = points(recursion, 2, rng)
    p = np.array([recursion.values(f) for f in free])
    x0 = recursion.x0 + 1e-3 * rng.standard_normal((2, len(recursion.x0)))
    X, J = rollout(torch_cell(data.model, friction, data.free), Records([record_of(recursion, steps)], CPU), p, x0)
    for b in range(2):
        x, s = rollout_sensitivities(kernel, x0[b], data.time, data.u, p[b], 2)
        assert_close(X[:, :, b], x)
        for k, name in enumerate(data.free):
            column = s[:, :, kernel.sensitive.index(name)]
            if np.any(column):
                assert_close(J[:, :, k, b], column)


def test_an_element_that_diverges_does_not_spoil_the_others():
    recursion, rng = problem("rigid_joint", {}, 1), np.random.default_rng(7)
    steps = [np.ones(len(recursion.data.time), dtype=np.int64)]
    free, levels = points(recursion, 4, rng)
    free[1], free[2, recursion.data.free.index("J")] = np.nan, 1e-300
    found = list(TorchPasses([recursion], steps).run(np.zeros(4, dtype=np.int64), free, levels))
    alone = list(TorchPasses([recursion], steps).run(np.zeros(2, dtype=np.int64), free[[0, 3]], levels[[0, 3]]))
    assert np.isnan(found[1].cost) and np.isnan(found[2].cost)
    for one, other in zip((found[0], found[3]), alone, strict=True):
        assert_close(one.cost, other.cost)
        assert_close(one.gradient, other.gradient)


def test_a_batch_beyond_the_memory_limit_is_cut():
    recursion, rng = problem("dc_motor", {}, 1, samples=60), np.random.default_rng(9)
    steps = [np.ones(len(recursion.data.time), dtype=np.int64)]
    free, levels = points(recursion, 5, rng)
    passes = TorchPasses([recursion], steps)
    whole = list(passes.run(np.zeros(5, dtype=np.int64), free, levels))
    assert passes.most > 5
    passes.most = 2
    for one, other in zip(passes.run(np.zeros(5, dtype=np.int64), free, levels), whole, strict=True):
        assert_close(one.cost, other.cost)
        assert_close(one.hessian, other.hessian)


def test_a_weight_counts_a_sample_as_often():
    """A record whose second half counts twice: the sums are those of all samples plus those of the second half."""
    recursion, rng = problem("rigid_joint", {}, 1, samples=100), np.random.default_rng(11)
    data = replace(recursion.data, gap=np.zeros_like(recursion.data.gap))
    recursion = Recursion(data, recursion.kernel)
    steps = np.ones(len(data.time), dtype=np.int64)
    free, levels = points(recursion, 1, rng)
    weights = np.where(np.arange(len(data.time)) < 50, 1.0, 2.0)
    (found,) = TorchPasses([recursion], [steps], weights=weights[None]).run(np.zeros(1, dtype=np.int64), free, levels)
    whole = recursion.run(free[0], levels[0], steps)
    hessian, gradient = recursion.since(whole, 50)
    assert_close(found.hessian, whole.hessian + hessian)
    assert_close(found.gradient, whole.gradient + gradient)
    share = whole.errors[50:] ** 2 / whole.variances[50:] + np.log(whole.variances[50:])
    assert_close(found.cost, whole.cost + share.sum())


def test_records_with_other_labels_are_refused():
    one, other = problem("harmonic_drive", {}, 1, samples=60), problem("rigid_joint", {}, 1, samples=60)
    steps = np.ones(len(one.data.time), dtype=np.int64)
    with pytest.raises(JointIdError, match="a batch holds one model"):
        TorchPasses([one, other], [steps, steps])
    with pytest.raises(JointIdError, match="at least one record"):
        Records([], CPU)


def test_devices():
    assert device_of("cpu") == CPU
    with pytest.raises(JointIdError, match="unknown device 'tpu': choose cpu or cuda"):
        device_of("tpu")
    if not torch.cuda.is_available():
        with pytest.raises(JointIdError, match="finds no GPU here: choose cpu"):
            device_of("cuda")


@pytest.mark.long
def test_samples_of_one_kind_need_the_same_operations(monkeypatch):
    """A GPU replays, for all samples of a kind, the operations of one of them: here every sample does those of the
    first of its kind."""
    recursions = [problem("harmonic_drive", {}, 1), problem("harmonic_drive", {}, 2, samples=100)]
    rng = np.random.default_rng(17)
    steps, record = [rng.integers(1, 4, len(r.data.time)) for r in recursions], np.array([0, 1, 1])
    free, levels = points(recursions[0], len(record), rng)
    expected = list(TorchPasses(recursions, steps).run(record, free, levels))
    works = {}
    monkeypatch.setattr(
        "joint_id_core.tensors.filter.Replay.run",
        lambda _, kind, work, *arguments: works.setdefault(kind, work)(*arguments),
    )
    found = list(TorchPasses(recursions, steps).run(record, free, levels))
    assert 1 < len(works) < 100  # samples share kinds
    for one, other in zip(found, expected, strict=True):
        assert (one.cost, one.gradient.tolist()) == (other.cost, other.gradient.tolist())
        assert one.hessian.tolist() == other.hessian.tolist()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here: PyTorch finds no CUDA device")
def test_the_gpu_equals_the_compiled_kernel():
    recursion, rng = problem("harmonic_drive", {}, 1), np.random.default_rng(13)
    steps = rng.integers(1, 4, len(recursion.data.time))
    free, levels = points(recursion, 20, rng)
    for b, found in enumerate(
        TorchPasses([recursion], [steps], "cuda").run(np.zeros(20, dtype=np.int64), free, levels)
    ):
        expected = recursion.run(free[b], levels[b], steps)
        assert_close(found.cost, expected.cost)
        assert_close(found.hessian, expected.hessian)


def test_the_filter_takes_the_labels_of_its_records():
    recursion = problem("dc_motor", {}, 1, samples=60)
    data = recursion.data
    records = Records([record_of(recursion, np.ones(len(data.time), dtype=np.int64))], CPU)
    of = InnovationsFilter(torch_cell(data.model, "tanh", data.free), records, data.label_states)
    sums = of.run(data.p[None], NoiseLevels.of(data).rough[None])
    assert sums.cost.shape == (1,) and sums.cross.shape == (1, len(data.free), len(data.noise_names))
