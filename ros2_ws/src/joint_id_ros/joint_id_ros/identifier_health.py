"""Diagnostics of the identifier: what it found, and whether it keeps up with the samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from joint_id_core.stored.knowledge import StoredKnowledge
from joint_id_msgs.msg import JointEstimate, ParameterEstimate
from joint_id_ros.baselines import Baselines
from joint_id_ros.diagnostics import Health
from joint_id_ros.estimate_bytes import DRIFT_TEXT, VERDICT
from joint_id_ros.sources import TOO_LATE_S, Sources
from joint_id_ros.worker import Worker

SLOW_S = 3.0  # a fit that takes longer is reported


class IdentifierHealth:
    """Remembers what the last report said, so that each one tells what is new."""

    def __init__(self) -> None:
        self._missed = 0

    def report(
        self,
        latest: Mapping[str, Mapping[str, Any]],
        fits: Mapping[str, int],
        worker: Worker,
        sources: Sources,
        knowledge: StoredKnowledge,
        baselines: Baselines,
    ) -> Health:
        """Return the report of a node that identifies; `latest` are the values that it published, by joint and field.

        To read them from a message object takes 5 ms for six joints, in which no estimate can be made.
        """
        values: dict[str, object] = {f"fits: {status}": n for status, n in sorted(fits.items())}
        late, level = self._lateness(worker, sources, values)
        bad, resting = [*sources.complaints, *late, *knowledge.refused], list[str]()
        values |= knowledge.store.values()
        values["joints with a baseline"] = ", ".join(baselines.joints)
        if knowledge.store.problem:
            bad.append(knowledge.store.problem)
            level = DiagnosticStatus.ERROR
        for name, joint in sorted(latest.items()):
            values[f"{name}: solve time [s]"] = f"{joint['solve_time']:.4f}"
            values[f"{name}: status"] = joint["message"]
            found = sum(row[VERDICT] == ParameterEstimate.ESTIMATED for row in joint["parameters"])
            if joint["age"] > 0.0:
                values[f"{name}: age of the parameters [s]"] = f"{joint['age']:.3f}"
            values[f"{name}: estimated"] = f"{found} of {len(joint['free'])} parameters"
            if joint["status"] == JointEstimate.NO_MOTION:
                resting.append(name)  # nothing is wrong: a warning would last all night
            elif joint["status"] != JointEstimate.CONVERGED:
                bad.append(f"{name}: {joint['message'].rstrip('.')}")
            if joint["drifts"]:
                bad.append(f"{name}: {'; '.join(drift[DRIFT_TEXT] for drift in joint['drifts'])}")
        if bad:
            level = max(level, DiagnosticStatus.WARN)
        moving = len(latest) - len(resting)
        told = bad or ([] if resting and not moving else [f"identified {moving} joints"])
        told += [f"at rest: {', '.join(resting)}"] if resting else []
        return Health(level, "; ".join(told), values)

    def _lateness(self, worker: Worker, sources: Sources, values: dict[str, object]) -> tuple[list[str], bytes]:
        """Return what is late in words, and its level; add the figures to `values`."""
        lag_s, waited_s, missed, waiting = worker.lag_s(), sources.slowest_s, worker.missed, worker.waiting
        values["backlog"] = worker.backlog
        values |= sources.values()
        values["lag of the estimates [s]"] = f"{lag_s:.3f}"
        values["missed hops"], values["samples left out"] = missed, worker.left_out
        values["joints that wait"] = ", ".join(waiting)
        new, self._missed = missed - self._missed, missed
        found = []
        if new > 0:
            found.append(f"{new} estimates were left out, because fits take longer than hop_s")
        if waiting:
            found.append(f"{', '.join(waiting)} wait for a fit")
        if lag_s + waited_s > TOO_LATE_S:
            found.append(f"the estimates are {lag_s + waited_s:.1f} s behind the newest sample")
        if worker.busy_s > SLOW_S:
            found.append(f"a fit takes {worker.busy_s:.0f} s so far")
        return found, DiagnosticStatus.ERROR if lag_s + waited_s > TOO_LATE_S else DiagnosticStatus.OK
