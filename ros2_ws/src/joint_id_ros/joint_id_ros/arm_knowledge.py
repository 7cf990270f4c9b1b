"""The arm that a node follows: its description, what is known of it, and the file that keeps that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from joint_id_core.arm import belief_file
from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.belief import Belief
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations, joined
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.gains import gains_of
from joint_id_core.arm.gravity import check_gravity
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import ArmStream
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.stored.autosave import Autosave
from joint_id_core.stored.file_lock import FileLock
from joint_id_ros.options.arm_identifier import ArmIdentifierOptions


class ArmKnowledge:
    """Follows an arm, and keeps what is known of it in a file if there is one.

    Attributes:
        regressor: of the arm; follower: of the present run.
        stretches: number of stretches of samples that were complete, at rest or in motion.
        problem: why the file is not used; empty if it is.
        scale: how far the torque constants are known, as a sentence; empty if that is not known.
    """

    def __init__(
        self, description: Description, options: ArmIdentifierOptions, tell: Callable[[str, str], None]
    ) -> None:
        """Take a description, and what the file holds; `tell` takes kind and text of a problem with it.

        Raises:
            JointIdError: an entry of `set` does not fit, or joints that follow others.
        """
        self.regressor = Regressor(description)
        self._gains, spread = gains_of(self.regressor.joints, options.entries)
        self.scale = f" All values scale with the torque constants, which are known to {spread}." if spread else ""
        self._source, self._mass = description.source, description.mass
        self._description = description
        self._path = Path(options.state_file).expanduser().absolute() if options.state_file else None
        self._saver = Autosave(self._write, tell) if self._path is not None else None
        self._lock = FileLock(self._path) if self._path is not None else None
        self._known: Belief | None = None
        self.problem, self.stretches = "", 0
        try:
            self._open()
        except JointIdError as error:
            self.problem = f"{error}. The arm is learnt anew, and nothing is written"
            tell("state file", self.problem)
        self.begin()

    @property
    def state(self) -> str:
        """Where what is known is kept, in words."""
        if self._path is None:
            return "none"
        problem = self.problem or ("" if self._saver is None else self._saver.problem)
        return f"{self._path}: {problem}" if problem else str(self._path)

    def begin(self) -> None:
        """Begin a run, as after a jump of the time, with what is known."""
        self._stream = ArmStream(self.regressor, self._gains, self._source)
        self.follower = ArmFollower(
            self.regressor.joints,
            self._mass,
            self._known,
            self._check,
            Beforehand.of(self.regressor),
            self._description,
        )
        if self._known is not None:
            self._stream.know(self._known.values, self._known.carries)

    def add(self, records: Mapping[str, Recording]) -> bool:
        """Take samples; return whether there is anything new to tell.

        Raises:
            JointIdError: see `ArmStream.push` and `check_gravity`.
        """
        new = False
        for block in self._stream.push(records):
            self.stretches += 1
            before = self.follower.rests, self.follower.unexplained
            learnt = self.follower.add(block)
            # In motion there is: that the torques were tested, even if what they say is not believed yet.
            new = new or not self.follower.rests or self.follower.belief is None or before != self._state()
            if learnt and (belief := self.follower.belief) is not None:
                self._known = belief
                self._stream.know(belief.values, belief.carries)
                if self._saver is not None and not self.problem:
                    self._saver.ask()
        return new

    def save(self) -> str:
        """Write the file now; return a sentence.

        Raises:
            JointIdError: there is none, nothing is known, or it cannot be written.
        """
        if self._saver is None:
            raise JointIdError("there is no file: set the parameter state_file and configure")
        if self.problem:
            raise JointIdError(self.problem)
        if self._known is None:
            raise JointIdError("nothing is known of the arm yet: let it move")
        self._saver.save()
        return f"saved what is known of the arm to {self._path}"

    def reset(self) -> str:
        """Forget the arm, and delete the file; return a sentence.

        Raises:
            JointIdError: the file cannot be deleted, or another node uses it.
        """
        if self._lock is not None:
            self._lock.take()
        if self._path is not None and self._saver is not None:
            self._saver.forget(self._remove)
        self._known, self.problem = None, ""
        self.begin()
        return "forgot the arm" + (f" and deleted {self._path}" if self._path is not None else "")

    def flush(self) -> None:
        """Write what is new."""
        if self._saver is not None:
            self._saver.flush()

    def close(self) -> None:
        """Write what is new, for the last time, and leave the file."""
        if self._saver is not None:
            self._saver.close()
        if self._lock is not None:
            self._lock.release()

    def _open(self) -> None:
        """Read the file, if there is one, and keep other nodes off it."""
        if self._path is None or self._lock is None:
            return
        self._lock.take()
        if self._path.exists():
            self._known = belief_file.read(self._path, self.regressor, self._gains)

    def _check(self, parts: Sequence[Equations]) -> None:
        """Check the direction of gravity by the motion from which the arm is learnt."""
        check_gravity(self._description, self.regressor, [joined(parts)])

    def _state(self) -> tuple[bool, tuple[str, ...]]:
        return self.follower.rests, self.follower.unexplained

    def _write(self) -> None:
        if self._path is not None and self._known is not None:
            belief_file.write(self._path, self._known, self.regressor, self._gains)

    def _remove(self) -> None:
        assert self._path is not None
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            raise JointIdError(f"{self._path}: cannot be deleted ({error.strerror})") from None
