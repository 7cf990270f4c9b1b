"""The H-PINN: its cell, its loss, its constraints, and the estimator built on them."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

torch = pytest.importorskip("torch")

from joint_id_core.data.recording import Recording  # noqa: E402
from joint_id_core.errors import JointIdError  # noqa: E402
from joint_id_core.estimators import HPinn, ParameterSettings  # noqa: E402
from joint_id_core.estimators.hpinn.fit import _minimum, fit_hpinn  # noqa: E402
from joint_id_core.estimators.hpinn.network import HPinnNetwork, RK4Cell, label_weights, wmse  # noqa: E402
from joint_id_core.estimators.hpinn.training import Labels, LearningRate, make_labels, train  # noqa: E402
from joint_id_core.estimators.shared.fit_data import prepare  # noqa: E402
from joint_id_core.models import MODELS, build  # noqa: E402
from joint_id_core.results.estimate import Status, Verdict  # noqa: E402

TABLE_I = {"R": 4.932e-1, "c_b": 2.537e-4, "k_b": 5.794e-2, "k_t": 5.507e-2, "tau_fc": 4.464e-2}


def motor_step(volts: float = 12.0, samples: int = 700, dt: float = 1e-3) -> Recording:
    """Step response of Model 1 in closed form: the current alone until it breaks the rotor free, then both."""
    p = SimpleNamespace(**build("dc_motor").values(TABLE_I))
    t = np.arange(samples) * dt
    t_free = -p.L / p.R * np.log(1.0 - p.tau_fc * p.R / (p.k_t * volts))
    A = np.array([[-p.R / p.L, -p.k_b / p.L], [p.k_t / p.J_r, -p.c_b / p.J_r]])
    b = np.array([volts / p.L, -p.tau_fc / p.J_r])
    at_rest = np.array([p.tau_fc / p.k_t, 0.0])
    steady = -np.linalg.solve(A, b)
    free = np.array([steady + expm(A * max(s, 0.0)) @ (at_rest - steady) for s in t - t_free])
    current = np.where(t < t_free, volts / p.R * (1.0 - np.exp(-p.R / p.L * t)), free[:, 0])
    velocity = np.where(t < t_free, 0.0, free[:, 1])
    return Recording(t, {"voltage": np.full(samples, volts), "current": current, "motor_velocity": velocity})


def brake_record(noise: float = 0.0, samples: int = 400) -> Recording:
    """A rigid joint that a sine drives, in closed form: J = 1.5, c = 4, no Coulomb friction, from rest."""
    t, J, c, amplitude, w = np.arange(samples) * 5e-3, 1.5, 4.0, 6.0, 5.0
    # J dv/dt + c v = F is exact here for an input that a controller holds between two samples
    drive = amplitude * np.sin(w * t) + 3.0
    decay = np.exp(-c / J * 5e-3)
    v = np.zeros(samples)
    for k in range(samples - 1):
        v[k + 1] = decay * v[k] + (1.0 - decay) * drive[k] / c
    v = v + noise * np.random.default_rng(3).normal(size=samples) * (t > 0)
    return Recording(t, {"torque": drive, "link_velocity": v})


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


def test_substeps_follow_a_straight_input():
    """With first-order hold, two substeps equal two steps with the input halfway in between."""
    model = build("motor_side")
    x0, time, u = random_record(model)
    u[:, 0] = 0.01  # the torque is held constant in both
    fine_time = np.sort(np.concatenate([time, (time[1:] + time[:-1]) / 2]))
    fine_u = np.column_stack([np.interp(fine_time, time, column) for column in u.T])
    start, values = torch.from_numpy(x0), model.values()
    coarse = HPinnNetwork(model, values, ["J_m"], substeps=2, compiled=False)(start, time, u)
    fine = HPinnNetwork(model, values, ["J_m"], substeps=1, compiled=False)(start, fine_time, fine_u)
    np.testing.assert_allclose(coarse.detach(), fine.detach()[::2], rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("friction", ["tanh", "sign"])
@pytest.mark.parametrize("name", list(MODELS))
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


def test_training_finds_the_motor_of_table_i():
    """From starts 20 % off, a 12 V step brings the loss down a thousandfold and every parameter nearer."""
    model, recording = build("dc_motor"), motor_step()
    signs = dict(zip(TABLE_I, (1, -1, 1, -1, 1), strict=True))
    start = {name: value * (1 + 0.2 * signs[name]) for name, value in TABLE_I.items()}
    data = prepare(model, recording, ParameterSettings(start))
    net = HPinnNetwork(model, model.values(start), data.free, substeps=2)
    labels = make_labels(data, torsion=True)
    history, finite = train(net, data, labels, np.zeros(2), 350, LearningRate(0.01, (0.4, 0.6, 0.8), 0.3))
    assert finite and len(history) == 350
    assert min(history) < 1e-3 * history[0]
    for name, truth in TABLE_I.items():
        assert abs(net.values[name] - truth) < abs(start[name] - truth), name
    for name in ("R", "k_b", "k_t"):  # c_b and tau_fc share one valley in this motion
        assert net.values[name] == pytest.approx(TABLE_I[name], rel=0.02), name


def test_estimator_with_one_label():
    """The paper's single-label row of Table II: the motor velocity alone still gives a fit of both signals."""
    full = motor_step(samples=500)
    partial = Recording(full.time, {n: full[n] for n in ("voltage", "motor_velocity")})
    start = {n: 1.1 * v for n, v in TABLE_I.items()}
    estimate = fit_hpinn(build("dc_motor"), partial, ParameterSettings(start), options=HPinn(epochs=350))
    assert set(estimate.nrmse) == {"motor_velocity"} and estimate.nrmse["motor_velocity"] < 0.02
    assert estimate["L"].verdict is Verdict.FIXED
    assert estimate["k_b"].value == pytest.approx(TABLE_I["k_b"], rel=0.03)


def test_labels_that_are_missing_here_and_there_change_little():
    """NaN labels are skipped one by one."""
    full = brake_record(noise=0.01)
    holes = full["link_velocity"].copy()
    holes[5::3] = np.nan
    options, fixed = HPinn(epochs=300), ("tau_f", "tau_0")
    values = {"tau_f": 0.0, "J": 1.2, "c": 5.0}
    a = fit_hpinn(build("rigid_joint"), full, ParameterSettings(values, fixed=fixed), options=options)
    b = fit_hpinn(
        build("rigid_joint"),
        full.with_channels({"link_velocity": holes}),
        ParameterSettings(values, fixed=fixed),
        options=options,
    )
    for name in ("J", "c"):
        assert abs(a[name].value - b[name].value) < 3 * b[name].std_dev
        assert b[name].std_dev > a[name].std_dev


def test_covariance_is_that_of_least_squares():
    """One white label: sigma^2 (J'J)^-1, with J by finite differences of the closed-form recursion."""
    recording = brake_record(noise=0.01)
    estimate = fit_hpinn(
        build("rigid_joint"), recording, ParameterSettings({"tau_f": 0.0, "J": 1.3, "c": 4.5}, fixed=("tau_f", "tau_0"))
    )
    assert estimate.status is Status.CONVERGED and estimate.free == ("J", "c")

    def velocity(J, c):
        v, decay = np.zeros(len(recording)), np.exp(-c / J * 5e-3)
        for k in range(len(v) - 1):
            v[k + 1] = decay * v[k] + (1 - decay) * recording["torque"][k] / c
        return v

    J, c = estimate["J"].value, estimate["c"].value
    jacobian = np.column_stack([
        (velocity(J + 1e-5, c) - velocity(J - 1e-5, c)) / 2e-5, (velocity(J, c + 1e-5) - velocity(J, c - 1e-5)) / 2e-5,
    ])  # fmt: skip
    residual = velocity(J, c) - recording["link_velocity"]
    expected = np.mean(residual**2) * np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(estimate.covariance, expected, rtol=1e-3)
    assert abs(estimate.whiteness["link_velocity"]) < 3 / np.sqrt(len(recording)), "white noise went in"
    assert estimate.noise["link_velocity"] == pytest.approx(0.01, rel=0.15)
    assert abs(J - 1.5) < 3 * estimate["J"].std_dev and abs(c - 4.0) < 3 * estimate["c"].std_dev


def test_interval_holds_the_estimate_at_its_bound():
    """An interval that excludes the truth ends with the verdict at_bound, no standard deviation, and the name."""
    options = HPinn(bounds={"c": (4.4, 6.0)})
    fixed = ("tau_f", "tau_0")
    estimate = fit_hpinn(
        build("rigid_joint"),
        brake_record(),
        ParameterSettings({"tau_f": 0.0, "J": 1.3, "c": 5.0}, fixed=fixed),
        options=options,
    )
    assert estimate["c"].verdict is Verdict.AT_BOUND and estimate["c"].value == pytest.approx(4.4)
    assert np.isnan(estimate["c"].std_dev) and estimate.free == ("J",)
    assert "At a bound: c." in estimate.notes


def test_too_few_epochs_are_not_called_converged():
    """A loss that still falls is said to fall."""
    start = {n: 1.2 * v for n, v in TABLE_I.items()}
    estimate = fit_hpinn(build("dc_motor"), motor_step(), ParameterSettings(start), options=HPinn(epochs=15))
    assert estimate.status is Status.MAX_ITERATIONS and "still falls" in estimate.message


def test_a_wrong_model_is_a_poor_fit():
    """A motion that the inputs do not explain is not reported as a success."""
    t = np.arange(300) * 5e-3
    recording = Recording(t, {"torque": np.sin(3 * t), "link_velocity": 5.0 * np.sin(40 * t + 1.0)})
    assert fit_hpinn(build("rigid_joint"), recording, options=HPinn(epochs=100)).status is Status.POOR_FIT


def test_an_unstable_step_is_diverged():
    """RK4 beyond its stability limit overflows; the estimate says so and keeps no numbers."""
    options = HPinn(epochs=5, substeps=1)
    estimate = fit_hpinn(build("rigid_joint"), brake_record(), ParameterSettings({"c": 2000.0}), options=options)
    assert estimate.status is Status.DIVERGED and "finite" in estimate.message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"options": {"bounds": {"k_t": (2.0, 1.0)}}}, "put the lower end first"),
        ({"options": {"bounds": {"k_x": (1.0, 2.0)}}}, "no parameter 'k_x'"),
        ({"options": {"bounds": {"R": (1.0, 2.0)}}}, "R starts at 0.4932"),
        ({"options": {"bounds": {"L": (0.0, 1.0)}}}, "L is fixed"),
        ({"options": {"decay_at": (1.5,)}}, "decay_at"),
        ({"options": {"epochs": 0}}, "epochs"),
        ({"values": {"tau_fc": 0.0}}, "tau_fc starts at 0"),
        ({"fixed": ("nothing",)}, "nothing"),
        ({"priors": {"R": 0.1}}, "hpinn has no priors"),
    ],
)
def test_misuse_is_named(change, said):
    """Each mistake in options, values or names is answered by one line that names it."""
    with pytest.raises(JointIdError) as error:
        fit_hpinn(
            build("dc_motor"),
            motor_step(samples=100),
            ParameterSettings(**{k: v for k, v in change.items() if k != "options"}),
            options=HPinn(**change.get("options", {})),
        )
    assert said in str(error.value) and "\n" not in str(error.value)


def test_unusable_data():
    """A hole in an input cannot be simulated through; a missing one or too few samples are a status."""
    recording, model = motor_step(samples=200), build("dc_motor")
    volts = recording["voltage"].copy()
    volts[50] = np.nan
    with pytest.raises(JointIdError, match="1 samples have no voltage"):
        fit_hpinn(model, recording.with_channels({"voltage": volts}))
    without = Recording(recording.time, {"current": recording["current"]})
    assert fit_hpinn(model, without).status is Status.MISSING_SIGNAL
    assert fit_hpinn(model, recording.slice(0, 5)).status is Status.TOO_SHORT


def test_without_torch():
    """The library imports and lists its options without torch; asking for the network says what to install."""
    code = """
import sys

class NoTorch:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NoTorch())
import numpy as np
import joint_id_core
from joint_id_core.estimators import HPinn
from joint_id_core.estimators.hpinn.fit import fit_hpinn
from joint_id_core.models import build
from joint_id_core.data.recording import Recording
HPinn()
try:
    fit_hpinn(build("dc_motor"), Recording(np.arange(3.0), {}))
except joint_id_core.errors.JointIdError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    assert "pip install torch" in run.stdout


def test_a_sum_that_labels_do_not_part_keeps_what_was_known_of_its_terms(monkeypatch):
    """Two columns of the Jacobian that are equal: their sum is known, each of them no better than before."""
    rng = np.random.default_rng(0)
    known, alike = rng.standard_normal((2, 400))
    jacobian = np.stack([known, alike, alike, np.zeros(400)], axis=1)[:, None, :]
    labels = Labels(("link_velocity",), rng.standard_normal((400, 1)), np.eye(1), np.array([0]))
    prior = np.array([1.0, 2.0, 2.0, 3.0])
    eigh = np.linalg.eigh
    for seed in range(5):

        def rotated(a, seed=seed):
            """Eigenvectors of the null space in another basis, as right as the first."""
            size, axes = eigh(a)
            turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((2, 2)))[0]
            return size, np.column_stack([axes[:, :2] @ turn, axes[:, 2:]])

        monkeypatch.setattr(np.linalg, "eigh", rotated)
        covariance, _, step = _minimum(jacobian, labels, np.ones(1), 0.1 * labels.y, prior)
        sd = np.sqrt(np.diag(covariance))
        assert sd[1:] == pytest.approx([np.sqrt(2.0), np.sqrt(2.0), 3.0], rel=1e-3)
        assert sd[0] < 0.01 and step[3] == 0.0
        assert np.sqrt(covariance[1, 1] + 2 * covariance[1, 2] + covariance[2, 2]) < 0.01
