"""What is preferred while it is not clear yet what happened to a joint."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from joint_id_core.online import pending_change
from joint_id_core.online.memory import BLOCK_S
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.pending_change import PATIENT, PendingChange
from joint_id_core.online.pending_changes import PendingChanges

Z = np.zeros(2)


class Filter:
    """Keeps where it was told to go on."""

    z: Any = None

    def again(self, pieces: Any, z: Any) -> None:
        self.z = z


class Pending:
    """A change that is explained as it is told, and confirmed if `right`."""

    def __init__(self, guess: bool = True, keeps: bool = True, right: bool = True, before: Any = None) -> None:
        self.explained, self.keeps, self.right, self.as_it_was = guess, guess and keeps, right, before
        self.unexplained, self.blocks = not guess, 0
        learned = SimpleNamespace(pieces=[], z=Z.copy())
        self.guess = (SimpleNamespace(learned=learned), None) if guess else None

    def add(self, block: Any) -> bool:
        self.blocks += 1
        return self.right and self.explained

    def learn(self, tracker: Any) -> None:
        pass

    def undone(self, tracker: Any, newest: Any, recent: Any) -> Any:
        return self.as_it_was


def pending(newest: Pending, earlier: Pending | None = None, undoable: tuple[Pending, ...] = ()) -> PendingChanges:
    many: Any = PendingChanges
    made: PendingChanges = many(newest, earlier, undoable, ())
    return made


@pytest.mark.parametrize(
    ("earlier", "newest", "first"),
    [
        (Pending(), Pending(), "earlier"),  # one change rather than two
        (Pending(keeps=False), Pending(), "newest"),  # a load rather than another joint
        (Pending(keeps=False), Pending(keeps=False), "earlier"),
        (Pending(keeps=False), Pending(guess=False), "earlier"),
        (Pending(guess=False), Pending(keeps=False), "newest"),
    ],
)
def test_what_keeps_more_of_what_was_known_is_more_likely(earlier, newest, first):
    one, tracker = pending(newest, earlier), Filter()
    assert one.learn(tracker) is None
    likely = earlier if first == "earlier" else newest
    assert one.guess is likely.guess
    assert tracker.z is likely.guess[0].learned.z
    assert one.add(tracker, None) is likely


def test_both_are_followed_until_one_is_confirmed():
    """An earlier change that explained the first samples of a new one was believed, and then nothing was."""
    earlier, newest = Pending(right=False), Pending()
    one, tracker = pending(newest, earlier), Filter()
    one.learn(tracker)
    assert one.add(tracker, None) is None and not one.unexplained
    earlier.guess = None
    assert one.learn(tracker) is None and one.guess is newest.guess
    assert one.add(tracker, None) is newest
    assert newest.blocks == 2


def test_a_joint_that_is_as_it_was_needs_no_confirmation():
    known = Pending()
    one, tracker = pending(Pending(), Pending(), (Pending(), Pending(before=known))), Filter()
    assert one.learn(tracker) is known
    assert tracker.z is known.guess[0].learned.z


def test_what_nothing_explains_is_said():
    one = pending(Pending(guess=False))
    assert one.learn(Filter()) is None
    assert one.unexplained and one.guess is None


def test_a_change_that_was_found_late_is_learned_as_long_as_any_other(monkeypatch):
    """One that only 16 s of motion showed was given up at once, and all that was known forgotten."""
    asked: list[tuple[int, bool]] = []
    refuted = SimpleNamespace(add=lambda *_: None, test=lambda: "a change")
    found = SimpleNamespace(all_new=False, memory=lambda *_: refuted)

    def learn(tracker: Any, blocks: Any, change: Any, coordinates: Any, one_cause: bool) -> Any:
        asked.append((len(blocks), one_cause))
        return found

    monkeypatch.setattr(pending_change, "learn", learn)
    options, block, nothing = OnlineOptions(), SimpleNamespace(duration=BLOCK_S), SimpleNamespace(spread=None)
    many: Any = PendingChange
    one = many(None, [block] * 33, nothing, options, None)
    one.learn(None)
    assert one.guess is not None and not one.unexplained
    while not one.unexplained:
        assert not one.add(block)
        one.learn(None)
    assert len(asked) == 1 + round(PATIENT * options.window_s / BLOCK_S)
    assert asked[:2] == [(32, True), (16, False)]  # the newer half, and no single cause
    assert all(4 <= count <= 16 for count, _ in asked[1:])
