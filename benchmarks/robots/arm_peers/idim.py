"""Plain IDIM-LS of a whole arm, as textbooks have it, written without the library: Pinocchio's regressor, base
parameters by a QR decomposition with pivoting, sign friction, a covariance for white residuals.

Joints are weighted by their residuals (Gautier, ICRA 1997). No rest is left out.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import pinocchio
import scipy

from joint_id_core.data.recording import Array
from robots.arm_peers.found import Found, scores
from robots.arm_peers.logs import PERIOD_S, Log, low_pass
from robots.fitted import Value

PACKAGE = "pin"
BAND_HZ = 4.0  # of both sides; of 4, 8 and 10 Hz this one predicts best
EVERY = 10  # samples, at 100 Hz: one is kept, 0.8 of the band that they can show
LEAST_PIVOT = 1e-7  # of the largest: smaller ones are dependent columns
WEIGHINGS = 2


def fit(urdf: str, log: Log, others: Sequence[Log]) -> Found:
    """Fit a log, and predict the others."""
    model = pinocchio.buildModelFromXML(urdf)
    begun = time.process_time()
    columns = regressor(model, log)
    margin = round(1.0 / (BAND_HZ * PERIOD_S))
    kept = slice(margin, len(log.time) - margin, EVERY)
    count, size = columns.shape[1:]
    offsets = np.broadcast_to(np.eye(count), (len(log.time), count, count))
    table = low_pass(np.concatenate([columns, offsets], axis=2), BAND_HZ)[kept]
    torque = low_pass(log.torque, BAND_HZ)[kept]
    found, sigma = least_squares(table, torque)
    cpu_s = time.process_time() - begun
    first = size - 2 * count
    friction = {
        name: [Value(float(found[k]), float(sigma[k])) for k in range(first + i * count, first + (i + 1) * count)]
        for i, name in enumerate(("damping", "friction"))
    }
    judged = scores(lambda other: regressor(model, other) @ found[:size], others)
    return Found(friction, *judged, (), (), cpu_s)


def regressor(model: pinocchio.Model, log: Log) -> Array:
    """Torques of the motion of a log by unit parameters: links, rotors, viscous friction, Coulomb friction."""
    q, dq, ddq = log.motion()
    data, own = model.createData(), np.eye(q.shape[1])
    links = np.array([
        pinocchio.computeJointTorqueRegressor(model, data, *state) for state in zip(q, dq, ddq, strict=True)
    ])  # fmt: skip
    return np.concatenate([links, *(values[:, :, None] * own for values in (ddq, dq, np.sign(dq)))], axis=2)


def least_squares(table: Array, torque: Array) -> tuple[Array, Array]:
    """Weighted least squares of base parameters.

    Values and standard deviations (P,) of the columns of a table (R, n, P) for torques (R, n); a dependent column has
    the value 0 and no standard deviation.
    """
    count, size = table.shape[1:]
    rows, y = table.reshape(-1, size), torque.ravel()
    scale = np.linalg.norm(rows, axis=0)
    some = np.flatnonzero(scale > 0.0)
    _, triangle, order = scipy.linalg.qr(rows[:, some] / scale[some], mode="economic", pivoting=True)
    pivots = np.abs(np.diag(triangle))
    base = np.sort(some[order[pivots > LEAST_PIVOT * pivots[0]]])
    weights = np.ones(count)
    for _ in range(WEIGHINGS):
        weighted = (rows[:, base].reshape(-1, count, len(base)) * weights[:, None]).reshape(-1, len(base))
        values = np.linalg.lstsq(weighted, (torque * weights).ravel(), rcond=None)[0]
        left = (y - rows[:, base] @ values).reshape(-1, count)
        weights = 1.0 / np.std(left, axis=0)
    variance = float(np.sum((left * weights) ** 2)) / (len(y) - len(base))
    weighted = (rows[:, base].reshape(-1, count, len(base)) * weights[:, None]).reshape(-1, len(base))
    found, sigma = np.zeros(size), np.full(size, np.nan)
    found[base] = values
    sigma[base] = np.sqrt(variance * np.diag(np.linalg.inv(weighted.T @ weighted)))
    return found, sigma
