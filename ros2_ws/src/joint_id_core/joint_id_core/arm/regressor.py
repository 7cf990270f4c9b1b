"""Torques of an arm as a linear function of its inertial parameters, and the combinations that any motion can show.

tau = Y(q, dq, ddq) theta, with ten parameters of each link (mass, first moments, inertia about the joint's frame) and
the inertia of each rotor (Atkeson, An & Hollerbach, International Journal of Robotics Research 5, 1986). Not all can be
told apart: a base parameter stands for one and those that always come with it (Gautier & Khalil, IEEE Transactions on
Robotics and Automation 6, 1990), found here from the dependence of the columns of Y at random states.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

OF_LINK = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
STATES = 60  # random ones
DEPENDENT = 1e-7  # what is left of a column of unit length that others explain
ROUNDED = 1e-12  # size of a column over that of the largest one which is rounding
SHOWN = 1e-6  # coefficient of a combination that is no rounding


class Regressor:
    """Base parameters of an arm.

    Attributes:
        joints: names of the joints, n of them; `links`: of the links that they move, and `last_link` the last one.
        combinations: what each of the B base parameters stands for, in words; the first n are those of the rotors.
        reference: their values by the description, without rotors, shape (B,).
        composition: what they are made of, shape (B, 11 n): of the rotors, and of ten parameters of each link.
        bodies: these ten of each link, with what is fixed to it, by the description, shape (n, 10).
        alone: whether each stands for one parameter alone, shape (B,).
    """

    def __init__(self, description: Description) -> None:
        """Find the base parameters.

        Raises:
            JointIdError: a joint follows another one.
        """
        import pinocchio

        if description.mimics:
            raise JointIdError(
                f"{description.source}: {', '.join(description.mimics)} follows another joint (mimic), which no linear "
                f"model has: if it stands still, say so (--still {description.leaders[0]}, or fixed in a copy of the "
                "description)"
            )
        self.joints = description.joints
        self.links = tuple(map(description.link_of, self.joints))
        self.last_link = self.links[-1]
        self._pinocchio, self._model = pinocchio, description.model
        self._data = self._model.createData()
        self._order = [description.column(name) for name in self.joints]
        count = len(self.joints)
        rng = np.random.default_rng(0)
        everything = self._everything(*rng.uniform(-2.0, 2.0, (3, STATES, count))).reshape(-1, 11 * count)
        size = np.linalg.norm(everything, axis=0)
        size[size < ROUNDED * size.max()] = 0.0  # else the rounding of a column that is zero would be a parameter
        scale = np.where(size > 0.0, size, 1.0)
        self._kept = _independent(everything / scale)
        others = np.setdiff1d(np.flatnonzero(size > 0.0), self._kept)
        kept = everything[:, self._kept] / scale[self._kept]
        share = np.linalg.lstsq(kept, everything[:, others], rcond=None)[0] / scale[self._kept, None]
        share[np.abs(share) * scale[self._kept, None] < SHOWN * scale[others]] = 0.0
        model = self._model
        self.bodies = np.array([model.inertias[model.getJointId(n)].toDynamicParameters() for n in self.joints])
        self.composition = np.zeros((len(self._kept), 11 * count))
        self.composition[np.arange(len(self._kept)), self._kept] = 1.0
        self.composition[:, others] = share
        self.reference = self.composition[:, count:] @ self.bodies.ravel()
        torque = np.abs(self.reference) * size[self._kept]
        self.reference[torque < ROUNDED * torque.max()] = 0.0  # what cancels leaves rounding
        names = [f"rotor of {name}" for name in self.joints]
        names += [f"{part} of {name}" for name in self.joints for part in OF_LINK]
        self.combinations = tuple(
            " ".join([names[k], *(f"{c:+.4g} {names[j]}" for c, j in zip(row, others, strict=True) if c)])
            for k, row in zip(self._kept, share, strict=True)
        )
        self.alone = ~np.any(share != 0.0, axis=1)

    @property
    def lengths(self) -> Array:
        """Distance in m from each joint to the farthest one that its link carries; of others the mean, shape (n,)."""
        model, found = self._model, np.zeros(len(self.joints))
        for name in self.joints:
            parent = model.parents[k := model.getJointId(name)]
            if parent > 0 and (before := model.names[parent]) in self.joints:
                j = self.joints.index(before)
                found[j] = max(found[j], float(np.linalg.norm(model.jointPlacements[k].translation)))
        return np.where(found > 0.0, found, found[found > 0.0].mean() if found.any() else 0.0)

    def rows(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """Return the torques of all joints by unit parameters, from motions of shape (T, n).

        Those of the base parameters, shape (T, n, B), and of the last link, which carries payloads, shape (T, n, 10).
        """
        everything = self._everything(q, dq, ddq)
        return everything[:, :, self._kept], everything[:, :, -len(OF_LINK) :]

    def _everything(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torques by all parameters, those of the rotors first, shape (T, n, 11 n)."""
        count, order = len(self.joints), self._order
        found = np.zeros((len(q), count, 11 * count))
        moved = np.zeros((3, len(q), count))
        for k, column in enumerate(order):
            moved[:, :, column] = q[:, k], dq[:, k], ddq[:, k]
            found[:, k, k] = ddq[:, k]
        bodies = np.concatenate([10 * column + np.arange(10) for column in order])
        place = np.ix_(np.array(order), bodies)
        for t, (at, speed, rate) in enumerate(zip(*moved, strict=True)):
            table = self._pinocchio.computeJointTorqueRegressor(self._model, self._data, at, speed, rate)
            table = table.reshape(count, -1)  # of one joint it has one axis
            found[t, :, count:] = table[place]
        return found


def _independent(columns: Array) -> Array:
    """Return the numbers of columns (S, m) of unit length that do not follow from those before them."""
    kept, basis = [], np.zeros((len(columns), 0))
    for k, column in enumerate(columns.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > DEPENDENT:
            kept.append(k)
            basis = np.column_stack([basis, rest / length])
    return np.array(kept, dtype=np.intp)
