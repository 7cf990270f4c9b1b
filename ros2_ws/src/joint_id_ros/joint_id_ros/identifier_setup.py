"""What the parameters of the identifier say: the identifier of every joint, and the kernels that these need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.checks import Background, at_once
from joint_id_core.stored.knowledge import StoredKnowledge
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.preparation import Preparation


@dataclass(frozen=True)
class IdentifierSetup:
    """Builds the identifiers of the joints from the options of the node."""

    model: IdentifierOptions
    online: OnlineOptions

    def begin(
        self, knowledge: StoredKnowledge, background: Background, joint: str, samples: Recording
    ) -> OnlineIdentifier:
        """Build the identifier of a joint from its first samples; it continues what is known of the joint.

        `background` does its checks of whole windows.
        """

        def make(joint: str, samples: Recording) -> OnlineIdentifier:
            return self._make(joint, self.model.drive_in(samples), background)

        return knowledge.continued(make, joint, samples)

    def prepare(self) -> Preparation:
        """Check all options by building every identifier that may be needed; start to compile or load their kernels.

        Raises:
            JointIdError: options that do not fit; the message names the joint, if only one is concerned.
        """
        joints = (*self.model.expected, *(() if self.model.joints else ("",)))
        if self.model.state_file and not (self.model.estimator == Innovations.name and self.online.memory_s):
            raise JointIdError("state_file needs a memory: leave it out, or take innovations and memory_s > 0")
        made = [identifier for joint in joints for identifier in self.possible(joint)]
        jobs = {(i.model, i.settings.freed_in(i.model)): i for i in made}
        new = [i for i in jobs.values() if not i.estimator.is_compiled(i.model, i.settings)]
        text = f"loading the kernels of model {self.model.model}"
        if new:
            text = f"compiling model {self.model.model} (only the first start of a model does that; others load it)"
        return Preparation([partial(i.estimator.compile, i.model, i.settings) for i in jobs.values()], text)

    def possible(self, joint: str) -> list[OnlineIdentifier]:
        """Return the identifiers of a joint with each possible drive signal, at least one."""
        made, errors = [], dict[str, JointIdError]()
        for drive in self.model.drives:
            try:
                made.append(self._make(joint, drive))
            except JointIdError as error:
                errors[drive] = error
        if made:
            return made
        told = "current" if "k_t" in self.model.values(joint) else "torque"  # drive that the user means
        wrong = errors.get(told) or next(iter(errors.values()))
        raise JointIdError(f"joint {joint}: {wrong}" if joint else str(wrong))

    def _make(self, joint: str, drive: str, background: Background = at_once) -> OnlineIdentifier:
        options = self.model
        return OnlineIdentifier(options.build(drive), options.settings(joint), self.online, options.solver, background)
