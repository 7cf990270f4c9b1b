"""The H-PINN as a network: its cell, its loss, its constraints, its labels."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

torch = pytest.importorskip("torch")

from joint_id_core.data.recording import Recording  # noqa: E402
from joint_id_core.errors import JointIdError  # noqa: E402
from joint_id_core.estimators import HPinn  # noqa: E402
from joint_id_core.estimators.hpinn.many import train_many  # noqa: E402
from joint_id_core.estimators.hpinn.network import HPinnNetwork, RK4Cell, label_weights, wmse  # noqa: E402
from joint_id_core.estimators.hpinn.training import LearningRate, make_labels, train  # noqa: E402
from joint_id_core.estimators.shared.fit_data import prepare  # noqa: E402
from joint_id_core.estimators.shared.initial_state import start_state  # noqa: E402
from joint_id_core.models import MODELS, build  # noqa: E402
from joint_id_core.simulation import simulate_motion  # noqa: E402

from .quick import first_quick  # noqa: E402


def random_record(model, samples=30):
    """Start state, uneven times and small inputs that keep every model within its stable range."""
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(5e-4, 1e-3, samples))
    return 0.01 * rng.normal(size=len(model.states)), time, 0.01 * rng.normal(size=(samples, len(model.inputs)))


def test_cell_has_order_four():
    """Halving the step divides the error by 16, against the closed form of a decaying velocity."""
    model = build("rigid_joint")
    p = SimpleNamespace(**{n: torch.tensor(v) for n, v in model.values({"J": 0.5, "c": 3.0, "tau_f": 0.0}).items()})
    u, rate, end = torch.tensor([6.0, 0.0], dtype=torch.float64), 3.0 / 0.5, 0.4
    exact = 2.0 + (1.0 - 2.0) * np.exp(-rate * end)
    errors = []
    for steps in (8, 16, 32):
        x, cell = torch.tensor([0.0, 1.0], dtype=torch.float64), RK4Cell(model)
        for _ in range(steps):
            x = cell(x, u, u, end / steps, p)
        errors.append(abs(x[1].item() - exact))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 4.0) < 0.2), orders


def test_substeps_follow_a_measured_motion():
    """Two substeps equal two steps with the input halfway: that of the link is on a parabola with its velocities."""
    model = build("motor_side")
    x0, time, u = random_record(model)
    u[:, 0] = 0.01  # the torque is held constant in both
    fine_time = np.sort(np.concatenate([time, (time[1:] + time[:-1]) / 2]))
    fine_u = np.column_stack([np.interp(fine_time, time, column) for column in u.T])
    q, w_q = (model.input_names.index(name) for name in ("link_position", "link_velocity"))
    fine_u[1::2, q] -= np.diff(time) * np.diff(u[:, w_q]) / 8.0
    start, values = torch.from_numpy(x0), model.values()
    coarse = HPinnNetwork(model, values, ["J_m"], substeps=2, compiled=False)(start, time, u)
    fine = HPinnNetwork(model, values, ["J_m"], substeps=1, compiled=False)(start, fine_time, fine_u)
    np.testing.assert_allclose(coarse.detach(), fine.detach()[::2], rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("friction", ["tanh", "sign"])
@pytest.mark.parametrize("name", first_quick(list(MODELS), 2))
def test_compiled_rollout_equals_the_eager_network(name, friction):
    """Values, loss and its gradients by the parameters agree to 1e-9."""
    model = build(name)
    x0, time, u = random_record(model)
    trainable = [p.name for p in model.parameters if not p.fixed]
    labels = np.random.default_rng(2).normal(size=(len(time), len(x0)))
    labels[3:9, 0] = np.nan
    found = []
    for compiled in (False, True):
        net = HPinnNetwork(model, model.values(), trainable, friction=friction, substeps=2, compiled=compiled)
        states = net(torch.from_numpy(x0), time, u)
        loss = wmse(states, torch.from_numpy(labels), torch.from_numpy(label_weights(labels)))
        loss.backward()
        found.append((states.detach(), loss.detach(), net.weight.grad))
    for eager, compiled in zip(*found, strict=True):
        np.testing.assert_allclose(compiled, eager, rtol=1e-9, atol=1e-9 * float(eager.abs().max()))


def test_a_gradient_by_the_start_state_is_refused_where_there_is_none():
    model = build("dc_motor")
    x0, time, u = random_record(model)
    start = torch.tensor(x0, requires_grad=True)
    with pytest.raises(JointIdError, match="compiled=False"):
        HPinnNetwork(model, model.values(), ["R"])(start, time, u)
    HPinnNetwork(model, model.values(), ["R"], compiled=False)(start, time, u).sum().backward()
    assert np.all(np.isfinite(start.grad.numpy()))


def test_a_freed_parameter_gets_its_gradient():
    """A parameter that the table fixes can be trained all the same."""
    model = build("dc_motor")
    x0, time, u = random_record(model)
    grads = []
    for compiled in (False, True):
        net = HPinnNetwork(model, model.values(), ["R", "L"], compiled=compiled)
        net(torch.from_numpy(x0), time, u).sum().backward()
        grads.append(net.weight.grad.numpy())
    assert abs(grads[0][1]) > 0
    np.testing.assert_allclose(grads[1], grads[0], rtol=1e-9)


def test_loss_by_hand():
    """Eqs 2 and 3 on numbers that can be checked on paper; the NaN label counts in neither sum nor mean."""
    labels = np.array([[2.0, -10.0], [4.0, 5.0], [np.nan, 10.0]])
    predicted = np.array([[3.0, -10.0], [2.0, 8.0], [99.0, 10.0]])
    weights = label_weights(labels)
    np.testing.assert_allclose(weights, [10.0 / 4.0, 1.0])
    x = torch.tensor(predicted, requires_grad=True)
    loss = wmse(x, torch.from_numpy(labels), torch.from_numpy(weights))
    assert loss.item() == pytest.approx(((2.5**2 * (1 + 4)) / 2 + (0 + 9 + 0) / 3) / 2)
    loss.backward()
    np.testing.assert_allclose(x.grad, [[2.5**2 / 2, 0.0], [-2 * 2.5**2 / 2, 1.0], [0.0, 0.0]])


@given(st.lists(st.floats(1e-6, 1e6), min_size=2, max_size=6), st.integers(0, 2**31))
@settings(max_examples=50, deadline=None)
def test_weights_level_the_peaks(peaks, seed):
    """Whatever the magnitudes of the states, each weighted label peaks at the largest of them."""
    labels = np.random.default_rng(seed).uniform(-1, 1, (20, len(peaks))) * peaks
    weighted = np.abs(labels * label_weights(labels)).max(axis=0)
    np.testing.assert_allclose(weighted, np.abs(labels).max())


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
@settings(max_examples=50, deadline=None)
def test_projection(weights):
    """After it positive parameters are positive, intervals hold, and a second projection changes nothing."""
    model = build("rigid_joint")
    net = HPinnNetwork(model, model.values(), ["J", "c", "tau_0"], {"c": (8.0, 12.0)}, compiled=False)
    with torch.no_grad():
        net.weight.copy_(torch.tensor(weights))
    net.project()
    values, once = net.values, net.weight.detach().clone()
    assert values["J"] > 0 and 8.0 - 1e-12 <= values["c"] <= 12.0 + 1e-12
    assert values["tau_0"] == pytest.approx(10.0 * weights[2]), "it may be negative"
    net.project()
    assert torch.equal(net.weight, once)


def test_torsion_label():
    """The extra label is theta_m / N - q, missing where either angle is, and its row maps states to it."""
    model = build("harmonic_drive")
    rng, samples = np.random.default_rng(4), 60
    channels = {n: rng.normal(size=samples) for n in (*model.state_names, "torque")}
    channels["motor_position"][7] = channels["link_position"][11] = np.nan
    data = prepare(model, Recording(np.arange(samples) * 1e-3, channels))
    labels = make_labels(data, torsion=True)
    expected = channels["motor_position"] / 101.0 - channels["link_position"]
    assert labels.names == (*model.state_names, "torsion")
    np.testing.assert_array_equal(np.isnan(labels.y[:, -1]), np.isnan(expected))
    np.testing.assert_allclose(labels.y[:, -1], expected, rtol=1e-12)
    x = np.array([101.0, 0.4, 7.0, 8.0])
    assert (labels.mix @ x[labels.states])[-1] == pytest.approx(0.6)
    assert make_labels(data, torsion=False).names == model.state_names


@pytest.mark.long
def test_many_networks_train_as_each_by_itself():
    """Two starts on each of two records, and one start that diverges: losses and values of the training one by one."""
    model = build("rigid_joint")
    motions = [simulate_motion(model, 0.24, 250.0, seed=seed) for seed in (1, 2)]
    free = prepare(model, motions[0]).free
    table = np.array([model.parameter(name).nominal for name in free])
    starts = np.stack([table * 1.2 + 0.01, table * 0.8 + 0.02, np.where(np.array(free) == "J", 1e-300, table + 0.01)])
    options = HPinn(epochs=6, substeps=1)
    found = train_many(model, motions, starts, estimator=options)
    rates = LearningRate(options.learning_rate, options.decay_at, options.decay_factor)
    for r, motion in enumerate(motions):
        assert np.isnan(found.losses[r, 2])
        for s in range(2):
            data = prepare(model, motion)
            values = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
            values |= dict(zip(free, starts[s].tolist(), strict=True))
            net = HPinnNetwork(model, values, free)
            history, _ = train(net, data, make_labels(data, True), start_state(data)[0], options.epochs, rates)
            assert abs(found.losses[r, s] / min(history) - 1.0) < 1e-9
            assert np.allclose(found.values[r, s], [net.values[name] for name in free], rtol=1e-9, atol=1e-12)
    with pytest.raises(JointIdError, match="give a row a start, a column for each of J"):
        train_many(model, motions, starts[:, :2])
