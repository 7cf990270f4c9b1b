"""Which of the fits of a joint with a computed load counts."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.estimators import ParameterSettings, fit, loaded_fit
from joint_id_core.results.estimate import Status

from .online_motion import MODEL, motion

AS_IT_IS, MATCHED = "as computed", "matched"


class Load:
    """A load that is to be matched only where the computed one leaves a poor fit."""

    second_choice = True

    def __init__(self, *_) -> None:
        pass

    def of(self, recording):
        return MATCHED

    def with_doubt(self, estimate, number=None):
        return estimate


@pytest.mark.parametrize("statuses", [
    (Status.CONVERGED,),
    (Status.POOR_FIT, Status.POOR_FIT),
    (Status.POOR_FIT, Status.CONVERGED, Status.POOR_FIT),
    (Status.POOR_FIT, Status.CONVERGED, Status.CONVERGED),
])  # fmt: skip
def test_a_computed_load_is_tried_again_from_the_values_with_a_matched_one(statuses, monkeypatch):
    good, settings = fit(MODEL, motion(3.0)), ParameterSettings({"J": 1.0})
    results = [good.updated(status=status, iterations=k) for k, status in enumerate(statuses)]
    tried = []

    def fitted(recording, chosen):
        tried.append((recording, chosen.values["J"]))
        return results[len(tried) - 1]

    monkeypatch.setattr(loaded_fit, "MatchedLoad", Load)
    monkeypatch.setattr(loaded_fit, "as_computed", lambda _: AS_IT_IS)
    found = loaded_fit.fitted_with_load(MODEL, [motion(3.0)], settings, fitted)
    found_j = good["J"].value
    assert tried == [(AS_IT_IS, 1.0), (MATCHED, 1.0), (AS_IT_IS, found_j)][: len(statuses)]
    last = len(statuses) - 1
    counts = last if statuses[last] is Status.CONVERGED or last < 2 else last - 1  # the matched one, if none is better
    assert (found.estimate.iterations, found.estimate.status) == (counts, statuses[counts])
    assert found.as_fitted(None) == (MATCHED if counts == 1 else AS_IT_IS)


@pytest.mark.parametrize(("matched", "counts"), [(Status.CONVERGED, 1), (Status.POOR_FIT, 0)])
def test_a_computed_load_that_a_fit_calls_noise_gives_way_to_a_matched_one_that_describes_the_motion(
    matched, counts, monkeypatch
):
    """Of a flexible joint k_1 was known to 6 % with the load as 1.4 Nm of noise, and to 1 % with a matched load."""
    good = fit(MODEL, motion(3.0))
    recording = motion(3.0).with_channels({loaded_fit.LOAD: np.ones(len(motion(3.0)))})
    noisy, quiet = ({f"input {loaded_fit.LOAD}": noise} for noise in (0.6, 0.05))
    results = iter([
        good.updated(noise=noisy, iterations=0), good.updated(noise=quiet, iterations=1, status=matched),
        good.updated(noise=noisy, iterations=2),
    ])  # fmt: skip
    monkeypatch.setattr(loaded_fit, "MatchedLoad", Load)
    monkeypatch.setattr(loaded_fit, "as_computed", lambda _: AS_IT_IS)
    found = loaded_fit.fitted_with_load(MODEL, [recording], None, lambda *_: next(results))
    assert (found.estimate.iterations, found.estimate.status) == (counts, Status.CONVERGED)
    assert found.as_fitted(None) == (MATCHED if counts == 1 else AS_IT_IS)


def test_a_recording_that_is_left_out_has_no_part_in_the_load(monkeypatch):
    """Another payload in one of two recordings spoilt the load of both."""
    good, made = fit(MODEL, motion(3.0)), []
    recordings = [motion(3.0), motion(3.0).slice(0, 1000)]

    class First(Load):
        second_choice = False

        def __init__(self, model, recordings, settings) -> None:
            made.append(list(recordings))

        def of(self, recording):
            return recording

    def fitted(recording, chosen):
        return good if recording is recordings[0] else good.updated(status=Status.POOR_FIT)

    monkeypatch.setattr(loaded_fit, "MatchedLoad", First)
    found = loaded_fit.fitted_with_load(MODEL, recordings, None, fitted)
    assert [len(one) for one in made] == [2, 1] and made[1][0] is recordings[0]
    assert found.estimate.converged and found.estimate["J"] == good["J"]
    assert "Only one recording can be used. Left out" in found.estimate.message
