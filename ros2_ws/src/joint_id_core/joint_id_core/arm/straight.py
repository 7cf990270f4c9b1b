"""Friction of joints that were too slow to show whether it bends: a straight line, in intervals that contain both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.arm.belief import Belief


def straightened(belief: Belief) -> Belief:
    """Return a belief without the bends of friction that no motion was fast enough to show.

    It is what the motion tells if they are 0. As they need not be, their effect is a standard deviation of it.
    """
    places = np.array([belief.friction_of(j)[2] for j in range(belief.count)])
    bends = places[~belief.seen[places]]
    own, cross = belief.covariance[np.ix_(bends, bends)], belief.covariance[bends]
    shift = -cross.T @ np.linalg.solve(own, belief.values[bends])
    covariance = belief.covariance - cross.T @ np.linalg.solve(own, cross) + np.outer(shift, shift)
    return replace(belief, values=belief.values + shift, covariance=covariance)
