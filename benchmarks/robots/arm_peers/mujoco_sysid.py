"""mujoco.sysid: masses and centres of the links, damping, dry friction and armature of the joints, and torque offsets,
by Gauss-Newton with its own intervals.

What it fits are sensors of a simulation. Torques alone, without a controller, do not keep a simulated arm near a
recorded motion for 50 s, so this is its way for simulations of one's own (`custom_rollout`): MuJoCo's inverse dynamics
along the recorded motion, read by torque sensors. The inertia of a link about its centre stays that of the description;
the choice that fits it as well (`InertiaType.Pseudo`) ends in mujoco 4.0.0 with "mass and inertia of moving bodies must
be larger than mjMINVAL".
"""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from joint_id_core.data.recording import Array
from robots.arm_peers.found import Found, scores
from robots.arm_peers.logs import BAND_HZ, Log, low_pass
from robots.fitted import Value

if not hasattr(sysid, "optimize"):  # it hides what it lacks
    raise ModuleNotFoundError("mujoco[sysid]", name="mujoco[sysid]")

PACKAGE = "mujoco"
POSITION_HZ = 10.0  # what it predicts passes no filter: this is near the band of the torques, and better than 20 Hz
EVERY = 5  # samples, at 100 Hz: one is kept
ITERATIONS = 50  # its default of 200 does not end by itself either, takes four times as long, and predicts .001 better
STARTS = {"damping": (5.0, 100.0), "frictionloss": (5.0, 100.0), "armature": (1.0, 50.0)}  # and upper bounds
OFFSET = 50.0  # Nm, its bound


def fit(urdf: str, log: Log, others: Sequence[Log]) -> Found:
    """Fit a log, and predict the others."""
    spec = _spec(urdf, log.joints)
    model = spec.compile()
    begun = time.process_time()
    parameters, offsets = _parameters(spec, model, log.joints)
    q, dq, ddq = (values[::EVERY] for values in log.motion(POSITION_HZ))
    times, torque = log.time[::EVERY], low_pass(log.torque, BAND_HZ)[::EVERY]

    def rollout(models: Any, datas: Any, control_signal: Any, initial_states: Any, **maps: Any) -> list[Any]:
        """Torques along the motion, in place of a simulation."""
        state = sysid.TimeSeries(times, np.column_stack([times, q, dq]), maps["rollout_state_mapping"])
        sensors = maps["rollout_signal_mapping"]
        found = (sysid.TimeSeries(times, inverse(one, q, dq, ddq), sensors) for one in models)
        parts = zip(models, control_signal, found, initial_states, strict=True)
        return [sysid.SystemTrajectory(*part, state) for part in parts]

    record = sysid.ModelSequences(
        "arm", spec, log.name, sysid.create_initial_state(model, q[0], dq[0]),
        sysid.TimeSeries.from_control_names(times, torque, model), sysid.TimeSeries.from_names(times, torque, model),
    )  # fmt: skip
    residual = sysid.build_residual_fn(
        models_sequences=[record], custom_rollout=rollout, modify_residual=offsets.apply, n_threads=1
    )
    with contextlib.redirect_stdout(io.StringIO()):
        best, result = sysid.optimize(parameters, residual, optimizer="mujoco", max_iters=ITERATIONS, verbose=False)
    left, _, _ = residual(result.x, best, return_pred_all=True)
    covariance, intervals = sysid.calculate_intervals(left, result.jac)
    cpu_s = time.process_time() - begun
    found = sysid.apply_param_modifiers(best, spec)
    judged = scores(lambda other: inverse(found, *other.motion()), others)
    note = f"stopped after {ITERATIONS} iterations" if len(result.extras["objective"]) > ITERATIONS else ""
    friction = {
        "damping": _values(best, covariance, log.joints, "damping"),
        "friction": _values(best, covariance, log.joints, "frictionloss"),
    }
    rotors = [float(best[f"{joint}_armature"].value[0]) for joint in log.joints]
    infinite = int(np.count_nonzero(np.isinf(intervals)))
    return Found(friction, *judged, rotors, found.body_mass[1:].tolist(), cpu_s, infinite, note)


def inverse(model: Any, q: Array, dq: Array, ddq: Array) -> Array:
    """Torques of a motion, shape (T, n)."""
    data, found = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def _spec(urdf: str, joints: Sequence[str]) -> Any:
    """The arm with a motor and a torque sensor in each joint."""
    spec = mujoco.MjSpec.from_string(urdf)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in joints:
        spec.add_actuator(name=f"{joint}_motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        spec.add_sensor(
            name=f"{joint}_torque", type=mujoco.mjtSensor.mjSENS_JOINTACTFRC, objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint,
        )  # fmt: skip
    return spec


def _parameters(spec: Any, model: Any, joints: Sequence[str]) -> tuple[Any, Any]:
    """What is fitted, and the transform that adds the offsets to the predicted torques."""
    parameters, offsets = sysid.ParameterDict(), sysid.SignalTransform()
    for body in range(1, model.nbody):
        name = model.body(body).name
        parameters.add(sysid.body_inertia_param(spec, model, name, inertia_type=sysid.InertiaType.MassIpos))
    for joint in joints:
        for quantity, (start, most) in STARTS.items():
            name = f"{joint}_{quantity}"
            parameters.add(sysid.Parameter(name, start, 0.0, most, modifier=_setter(joint, quantity)))
        parameters.add(sysid.Parameter(f"{joint}_offset", 0.0, -OFFSET, OFFSET))
        offsets.bias(f"{joint}_torque", parameters[f"{joint}_offset"])
    return parameters, offsets


def _setter(joint: str, quantity: str) -> Any:
    def put(spec: Any, parameter: Any) -> None:
        place, value = spec.joint(joint), float(parameter.value[0])
        if quantity == "damping":
            place.damping[0] = value  # the linear term
        else:
            setattr(place, quantity, value)

    return put


def _values(best: Any, covariance: Array, joints: Sequence[str], quantity: str) -> list[Value]:
    """Values of the joints with the standard deviations of the covariance: infinite intervals tell nothing."""
    places, k = {}, 0
    for name, parameter in best.items():
        places[name] = k
        k += parameter.size
    names = [f"{joint}_{quantity}" for joint in joints]
    return [Value(float(best[n].value[0]), float(np.sqrt(covariance[places[n], places[n]]))) for n in names]
