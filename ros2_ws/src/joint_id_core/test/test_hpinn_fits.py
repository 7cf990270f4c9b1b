"""The H-PINN as an estimator: training, what a fit says of itself, and wrong input."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("torch")

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import HPinn, ParameterSettings, fit
from joint_id_core.estimators.hpinn.fit import _minimum, fit_hpinn
from joint_id_core.estimators.hpinn.network import HPinnNetwork
from joint_id_core.estimators.hpinn.training import Labels, LearningRate, make_labels, train
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.simulation import simulate_motion

from .readable import readable

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


def fitted(*given, **options):
    """Return what `fit_hpinn` does; its message is readable."""
    estimate = fit_hpinn(*given, **options)
    readable(estimate.message, estimate.source)
    return estimate


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
    estimate = fitted(build("dc_motor"), partial, ParameterSettings(start), options=HPinn(epochs=350))
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
    a = fitted(build("rigid_joint"), full, ParameterSettings(values, fixed=fixed), options=options)
    b = fitted(
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
    estimate = fitted(
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
    estimate = fitted(
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
    estimate = fitted(build("dc_motor"), motor_step(), ParameterSettings(start), options=HPinn(epochs=15))
    assert estimate.status is Status.MAX_ITERATIONS and "still falls" in estimate.message


def test_a_wrong_model_is_a_poor_fit():
    """A motion that the inputs do not explain is not reported as a success."""
    t = np.arange(300) * 5e-3
    recording = Recording(t, {"torque": np.sin(3 * t), "link_velocity": 5.0 * np.sin(40 * t + 1.0)})
    assert fitted(build("rigid_joint"), recording, options=HPinn(epochs=100)).status is Status.POOR_FIT


def test_an_unstable_step_is_diverged():
    """RK4 beyond its stability limit overflows; the estimate says so and keeps no numbers."""
    options = HPinn(epochs=5, substeps=1)
    estimate = fitted(build("rigid_joint"), brake_record(), ParameterSettings({"c": 2000.0}), options=options)
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
        fitted(
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
        fitted(model, recording.with_channels({"voltage": volts}))
    without = Recording(recording.time, {"current": recording["current"]})
    assert fitted(model, without).status is Status.MISSING_SIGNAL
    assert fitted(model, recording.slice(0, 5)).status is Status.TOO_SHORT


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


def test_a_positive_parameter_known_to_no_half_of_its_value_is_not_estimated():
    """k_2 was estimated as 4.0e5 ± 9.3e5 Nm/rad^3, as its prior is wider still."""
    model = build("electromechanical")
    found = fit(model, simulate_motion(model, 6.0), estimator=HPinn(epochs=20))
    wide = [p for p in found.parameters if model.parameter(p.name).positive and p.std_dev > 0.5 * p.value]
    assert "k_2" in [p.name for p in wide] and not [p for p in wide if p.verdict is Verdict.ESTIMATED]
