"""What a live page shows of many robots: a row for each robot and for each of its joints, what is new first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any

from joint_id_core.errors import JointIdError
from joint_id_core.pages.document import Page
from joint_id_core.pages.live import LOOKS, Seen, parameter_rows

GONE = "gone"


@dataclass
class _Joint:
    seen: Seen
    news_s: float  # when its status or its alarms changed last


@dataclass
class _Robot:
    heard_s: float
    joints: dict[str, _Joint] = field(default_factory=dict)
    gone_s: float | None = None  # since when
    payload: str = ""
    level: int = 0  # of the diagnostics of its nodes, the worst
    says: str = ""


class FleetView:
    """The joints of many robots as they are identified. Instants are in s on any clock that does not jump."""

    def __init__(self) -> None:
        self._robots: dict[str, _Robot] = {}

    def take(self, robot: str, joints: Mapping[str, Seen], now_s: float) -> None:
        """Take what a robot published last; joints that are not in it are gone."""
        known = self._robots.setdefault(robot, _Robot(now_s))
        before, known.heard_s = known.joints, now_s
        known.joints = {name: _Joint(seen, _news(before.get(name), seen, now_s)) for name, seen in joints.items()}

    def carries(self, robot: str, payload: str, now_s: float) -> None:
        """Take what a robot carries, in words."""
        self._robots.setdefault(robot, _Robot(now_s)).payload = payload

    def nodes(self, robot: str, level: int, says: str) -> None:
        """Take the worst level of the diagnostics of a robot's nodes, and what these say."""
        if robot in self._robots:
            self._robots[robot].level, self._robots[robot].says = level, says

    def there(self, robot: str, there: bool, now_s: float) -> None:
        """Note whether anything still publishes what is known of a robot."""
        known = self._robots.get(robot)
        if known is not None and there is (known.gone_s is not None):
            known.gone_s = None if there else now_s
            for joint in known.joints.values():
                joint.news_s = now_s

    def state(self, now_s: float) -> dict[str, Any]:
        """Return the rows of robots, by name, and of joints, those whose status changed last first."""
        joints = sorted(
            (-joint.news_s, name, of, joint)
            for name, robot in self._robots.items()
            for of, joint in robot.joints.items()
        )
        return {
            "robots": [self._robot_row(name, robot, now_s) for name, robot in sorted(self._robots.items())],
            "joints": [self._joint_row(name, of, joint, now_s) for _, name, of, joint in joints],
        }

    def joint(self, robot: str, joint: str) -> dict[str, Any]:
        """Return what is known of one joint.

        Raises:
            JointIdError: there is none of this name.
        """
        known = self._robots.get(robot)
        if known is None or joint not in known.joints:
            raise JointIdError(f"joint {joint!r} of robot {robot!r} is not published")
        seen = known.joints[joint].seen
        return {
            "message": seen.estimate.message, "alarms": [*seen.changes, *seen.drifts],
            "parameters": parameter_rows(seen.estimate),
        }  # fmt: skip

    @staticmethod
    def _robot_row(name: str, robot: _Robot, now_s: float) -> list[Any]:
        """Name, whether it is gone, number of joints, good and wrong ones, age of the newest estimate, and so on."""
        looks = [LOOKS.get(joint.seen.estimate.status, "") for joint in robot.joints.values()]
        gone = robot.gone_s is not None
        says = f"gone for {now_s - (robot.gone_s or now_s):.0f} s" if gone else robot.says
        return [
            name, gone, len(looks), looks.count("good"), looks.count(""), round(now_s - robot.heard_s, 1),
            robot.payload, robot.level, says,
        ]  # fmt: skip

    def _joint_row(self, robot: str, name: str, joint: _Joint, now_s: float) -> list[Any]:
        """Robot, joint, status and its look, model, age of the parameters, how long ago it was news, alarms."""
        estimate, gone = joint.seen.estimate, self._robots[robot].gone_s is not None
        status = (GONE, "idle") if gone else (estimate.status.value, LOOKS.get(estimate.status, ""))
        age_s = joint.seen.age_s + now_s - self._robots[robot].heard_s
        alarms = "; ".join((*joint.seen.changes, *joint.seen.drifts))
        return [
            robot, name, *status, estimate.model, round(age_s, 1), round(now_s - joint.news_s), alarms,
            _found(joint.seen),
        ]  # fmt: skip


def fleet_page(title: str) -> str:
    """Return the page that shows a `FleetView`, which it asks a `server.PageServer` for."""
    page = Page(title, ("parts.js", "fleet.js"))
    page.head(
        f'<h1>{escape(title)} <span class="status" id="link">not connected</span></h1>',
        '<p class="message" id="told">Waiting for robots.</p>',
    )
    page.section("Robots", '<div class="wide" id="robots"></div>')
    page.section(
        "Joints",
        '<p class="hint">What changed last stands first. <input id="wanted" placeholder="robot, joint or status"></p>',
        '<div class="wide" id="joints"></div>',
    )
    page.section("Parameters", '<p id="says">Choose a joint above.</p>', '<div class="wide" id="parameters"></div>')
    return page.html()


def _news(before: _Joint | None, seen: Seen, now_s: float) -> float:
    if before is None:
        return now_s
    old = before.seen
    same = (old.estimate.status, len(old.changes), len(old.drifts)) == (
        seen.estimate.status, len(seen.changes), len(seen.drifts),
    )  # fmt: skip
    return before.news_s if same else now_s


def _found(seen: Seen) -> str:
    """Return how many of the free parameters are estimated."""
    free = [p for p in seen.estimate.parameters if p.name in seen.estimate.free]
    return f"{sum(p.verdict.value == 'estimated' for p in free)} of {len(free)}"
