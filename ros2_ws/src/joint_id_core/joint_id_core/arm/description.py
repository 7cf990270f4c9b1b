"""The description of a robot (URDF, or MJCF) as rigid links: what a joint must give beside what accelerates it.

Inverse dynamics by the recursive Newton-Euler algorithm, and the inertia of what a joint moves by the composite rigid
body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5 and 6), both of the library Pinocchio.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.from_mjcf import is_mjcf, urdf_of
from joint_id_core.arm.urdf import built, end_of, mimics_of, parsed, with_still
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError, close_to

GRAVITY = (0.0, 0.0, -9.81)  # m/s^2 in the frame of the base: it stands on the floor
HEAVIEST, LONGEST = 1e4, 50.0  # kg and m of all links together; more is of other units


@dataclass(frozen=True)
class Load:
    """What the arm does to one of its joints (T,), or to all (T, joints), in Nm and kg m^2 (N and kg where prismatic).

    Attributes:
        torque: gravity, Coriolis and centrifugal torque, and that of the accelerations of other joints; it acts against
            positive motion, as the channel `external_torque`.
        inertia: of all links that the joint moves, about its axis.
    """

    torque: Array
    inertia: Array


class Description:
    """Rigid links and joints of a robot. Meshes are not needed.

    Attributes:
        joints: names of those that move by themselves, from the base on.
        source: where the description came from.
        text: the URDF.
        still: joints that count as fixed at 0 as the user says so.
    """

    def __init__(
        self,
        text: str,
        source: str = "robot_description",
        gravity: Sequence[float] = GRAVITY,
        payload: tuple[float, Array] | None = None,
    ) -> None:
        """Take a URDF.

        Args:
            text: the URDF.
            source: where it came from, for messages.
            gravity: in m/s^2, in the frame of the base, shape (3,).
            payload: mass in kg that the last link carries beside at a point in m in its joint's frame, shape (3,).

        Raises:
            JointIdError: Pinocchio is not installed, no URDF, a joint of an unknown kind, a link that moves and has no
                mass, units other than kg and m, a gravity that is none.
        """
        self.source, self.text, self.still = source, text, tuple[str, ...]()
        root = parsed(text, source)
        self._mimics = mimics_of(root, source)
        self._model: Any = built(root, source)
        names = tuple(self._model.names)[1:]
        self.joints = tuple(name for name in names if name not in self._mimics)
        self._column = {name: self._model.joints[self._model.getJointId(name)].idx_v for name in names}
        self._model.gravity.linear = checked_gravity(gravity)
        if payload is not None:
            import pinocchio

            last = self._model.getJointId(self.joints[-1])
            self._model.inertias[last] += pinocchio.Inertia(*payload, np.zeros((3, 3)))
        self._data = self._model.createData()
        self._links = {joint.get("name", ""): end_of(joint, "child") for joint in root.findall("joint")}
        self._check_bodies()

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which of `joints` turn; the others slide."""
        kinds = [self._model.joints[self._model.getJointId(name)].shortname() for name in self.joints]
        return np.array([not kind.startswith("JointModelP") for kind in kinds])

    @property
    def leaders(self) -> tuple[str, ...]:
        """Names of the joints that others follow."""
        return tuple(dict.fromkeys(mimic.joint for mimic in self._mimics.values()))

    @property
    def mimics(self) -> tuple[str, ...]:
        """Names of joints that follow another one."""
        return tuple(self._mimics)

    @property
    def fixed(self) -> tuple[str, ...]:
        """Names of joints that do not move."""
        return tuple(name for name in self._links if name not in self._column)

    @property
    def model(self) -> Any:
        """The model of Pinocchio."""
        return self._model

    @property
    def gravity(self) -> Array:
        """Gravity in m/s^2, in the frame of the base, shape (3,)."""
        return np.array(self._model.gravity.linear)

    @property
    def mass(self) -> float:
        """Mass in kg of all links that move."""
        return float(sum(body.mass for body in list(self._model.inertias)[1:]))

    def link_of(self, joint: str) -> str:
        """Return the name of the link that a joint moves."""
        return self._links[joint]

    def column(self, joint: str) -> int:
        """Return the number of a joint in the vectors of Pinocchio."""
        return int(self._column[joint])

    @classmethod
    def read(cls, path: str | Path, gravity: Sequence[float] = GRAVITY, still: Collection[str] = ()) -> Description:
        """Read a URDF or MJCF file. Gravity is that of the argument, not of the file.

        Joints that stand `still` count as fixed at 0, as those of a gripper that no recording holds.

        Raises:
            JointIdError: the file cannot be read; as for the constructor and `from_mjcf.urdf_of`.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "not a text file"
            raise JointIdError(f"{path}: cannot be read ({reason}): give a URDF file") from None
        text = urdf_of(Path(path)) if is_mjcf(text) else text
        found = cls(with_still(text, still, str(path)), str(path), gravity)
        found.still = tuple(still)
        return found

    def require(self, joint: str) -> None:
        """Check that a joint moves by itself and drives no other one.

        Raises:
            JointIdError: it does not; the message says what there is.
        """
        if joint not in self.joints:
            why = f"{joint} follows {self._mimics[joint].joint}" if joint in self._mimics else f"it has no {joint!r}"
            raise JointIdError(
                f"{self.source}: {why}; its joints that move by themselves are {', '.join(self.joints)}"
                f"{close_to(joint, self.joints)}: joints are found by name"
            )
        if followers := [name for name, mimic in self._mimics.items() if mimic.joint == joint]:
            raise JointIdError(
                f"{self.source}: {', '.join(followers)} follows {joint} (mimic) and loads it through a gear, which no "
                "URDF describes: no load is computed for it"
            )

    def load(self, joint: str, q: Array, dq: Array, ddq: Array) -> Load:
        """Return the load of a joint, shape (T,); arguments as for `loads`.

        Raises:
            JointIdError: see `require`.
        """
        self.require(joint)
        found, k = self.loads(q, dq, ddq), self.joints.index(joint)
        return Load(found.torque[:, k], found.inertia[:, k])

    def loads(self, q: Array, dq: Array, ddq: Array) -> Load:
        """Return the loads of all `joints`, shape (T, joints). That of a joint that drives another one is wrong.

        Args:
            q, dq, ddq: positions (rad, m), velocities and accelerations of `joints`, shape (T, joints); where one is
                NaN, so are the loads.
        """
        import pinocchio

        model, data, own = self._model, self._data, [self._column[name] for name in self.joints]
        motion = np.full((3, len(q), model.nv), np.nan)
        motion[:, :, own] = q, dq, ddq
        for name, mimic in self._mimics.items():
            motion[:, :, self._column[name]] = mimic.factor * motion[:, :, self._column[mimic.joint]]
            motion[0, :, self._column[name]] += mimic.offset
        torque, inertia = np.full((2, len(q), model.nv), np.nan)
        for k in np.flatnonzero(np.isfinite(motion).all(axis=(0, 2))).tolist():
            at, speed, rate = motion[:, k]
            inertia[k] = pinocchio.crba(model, data, at).diagonal()
            torque[k] = pinocchio.rnea(model, data, at, speed, rate) - inertia[k] * rate
        return Load(torque[:, own], inertia[:, own])

    def by_position(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return how the torques of all `joints` change with their positions, shape (T, joints, joints).

        Arguments are as for `loads`, of a robot in which no joint follows another one.
        """
        import pinocchio

        own = [self._column[name] for name in self.joints]
        motion = np.full((3, len(q), self._model.nv), np.nan)
        motion[:, :, own] = q, dq, ddq
        found = np.full((len(q), len(own), len(own)), np.nan)
        for k in np.flatnonzero(np.isfinite(motion).all(axis=(0, 2))).tolist():
            slope = pinocchio.computeRNEADerivatives(self._model, self._data, *motion[:, k])[0]
            found[k] = slope[np.ix_(own, own)]
        return found

    def _check_bodies(self) -> None:
        """Check masses and lengths of what moves."""
        model, child = self._model, self._links
        for name, body in zip(tuple(model.names)[1:], list(model.inertias)[1:], strict=True):
            if not body.mass > 0.0:
                raise JointIdError(
                    f"{self.source}: link {child[name]!r}, which joint {name} moves, has mass {body.mass:g} kg: give "
                    "it an <inertial> with its mass, or make the joint fixed"
                )
            if np.linalg.eigvalsh(body.inertia).min() < -1e-9 * body.mass:
                raise JointIdError(f"{self.source}: link {child[name]!r} has an inertia that no body has: correct it")
        mass = self.mass
        reach = sum(float(np.linalg.norm(place.translation)) for place in list(model.jointPlacements)[1:])
        if mass > HEAVIEST or reach > LONGEST:
            raise JointIdError(
                f"{self.source}: its links have {mass:.3g} kg and reach {reach:.3g} m: a URDF is in kg and m"
            )


def checked_gravity(gravity: Sequence[float]) -> Array:
    """Return gravity as an array, shape (3,).

    Raises:
        JointIdError: these are not three numbers, or no gravity in m/s^2.
    """
    try:
        found = np.asarray(gravity, dtype=float)
    except ValueError:
        found = np.full(3, np.nan)
    size = float(np.linalg.norm(found)) if found.shape == (3,) else np.nan
    if not (size == 0.0 or 9.0 < size < 10.5):
        raise JointIdError(
            f"gravity {list(gravity)}: give three numbers in m/s^2 in the frame of the base, such as "
            f"{', '.join(f'{g:g}' for g in GRAVITY)} for a base that stands on the floor"
        )
    return found
