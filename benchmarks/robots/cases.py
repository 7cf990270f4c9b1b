"""Which recordings are fitted by which model, and what is known of the joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from joint_id_core.data.recording import Recording
from robots.fitted import FRICTION
from robots.recordings import DATA, UR10E_ALL, emps, parts, ur3e_shoulder, ur10e, ur10e_of_arm


@dataclass(frozen=True)
class Known:
    """A value of someone else, and how much their recordings differ (0 where that is not told)."""

    value: float
    spread: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A joint of a case.

    Attributes:
        name: in the tables.
        fitted: reads the recordings that are fitted; each is also predicted by the fits of the others.
        gravity: whether the model has gravity.
        known: values of others by parameter.
        only_predicted: reads recordings that are not fitted.
    """

    name: str
    fitted: Callable[[], list[Recording]]
    gravity: bool = False
    known: Mapping[str, Known] = field(default_factory=dict)
    only_predicted: Callable[[], list[Recording]] = list


@dataclass(frozen=True)
class Case:
    """Joints that were recorded alike. `alone`: only this joint moves. `folder`: of the data."""

    name: str
    folder: str
    alone: bool
    joints: tuple[Joint, ...]

    @property
    def there(self) -> bool:
        """Whether its data are there."""
        return (DATA / self.folder).is_dir()


# UR10e, least squares of the whole arm, with the spread between seven logs; that of the inertias is not known.
ARM = {
    1: {"c": Known(21.9, 1.3), "tau_f": Known(16.4, 0.4)},  # J changes with the pose
    2: {"c": Known(18.4, 1.6), "tau_f": Known(17.0, 0.9), "J": Known(17.5)},
    3: {"c": Known(9.6, 0.7), "tau_f": Known(6.8, 0.3), "J": Known(4.1)},
    4: {"c": Known(3.6, 0.2), "tau_f": Known(2.8, 0.1), "J": Known(0.47)},
    5: {"c": Known(2.45, 0.1), "tau_f": Known(3.2, 0.05), "J": Known(0.43)},
    6: {"c": Known(3.2, 0.2), "tau_f": Known(2.5, 0.05), "J": Known(0.42)},
}
# The data's authors, of the log in which joint 1 moves alone: 0.597 A s2/rad, 2.197 A s/rad, 1.365 A.
BASE = {"J": Known(11.8 * 0.597), "c": Known(11.8 * 2.197), "tau_f": Known(11.8 * 1.365)}
# Janot, Gautier, Brunot 2019
EMPS = {"J": Known(95.1089), "c": Known(203.5034), "tau_f": Known(20.3935)}


def _alone(joint: int, gravity: bool, known: Mapping[str, Known]) -> Joint:
    return Joint(f"joint {joint}", lambda: parts(ur10e(f"ur-20_01_22-joint_{joint}", joint), 3), gravity, known)


def _of_arm(joint: int) -> Joint:
    # With a computed load, J holds the mean inertia over all poses; the reference has that of the poses in these logs.
    known = {n: v for n, v in ARM[joint].items() if n in FRICTION or joint > 3}
    return Joint(f"joint {joint}", partial(ur10e_of_arm, joint), False, known)


def _of_all(joint: int, load: bool) -> Joint:
    def read() -> list[Recording]:
        return [ur10e(name, joint, load) for name in UR10E_ALL]

    # The controller's load contains the inertia.
    known = {n: v for n, v in ARM[joint].items() if n in FRICTION} if load else ARM[joint]
    return Joint(f"joint {joint}", read, joint > 1 and not load, known)


CASES = (
    Case("UR10e, one joint moves", "ur10e", True, (_alone(1, False, BASE), _alone(4, True, ARM[4]))),
    Case("UR3e, shoulder moves", "ur3e", True, (Joint("shoulder", lambda: parts(ur3e_shoulder(), 2), True),)),
    Case(
        "EMPS, linear axis", "emps", True,
        (Joint("axis", lambda: [emps()], False, EMPS, lambda: [emps("DATA_EMPS_PULSES")]),),
    ),
    Case("UR10e, all joints move", "ur10e", False, tuple(_of_all(joint, False) for joint in ARM)),
    Case("UR10e, all move, external torque", "ur10e", False, tuple(_of_all(joint, True) for joint in ARM)),
    Case(
        "UR10e, all move, load of a URDF", "ur10e", False,
        tuple(_of_arm(joint) for joint in ARM),
    ),
)  # fmt: skip
