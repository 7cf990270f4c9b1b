"""What the data show about a parameter, and from which standard deviation on."""

from __future__ import annotations

import enum

# Ratio of posterior to prior standard deviation. Above NOT_EXCITED_RATIO the data hold almost no information on the
# parameter. Above PRIOR_RATIO they hold too little to call the parameter estimated.
NOT_EXCITED_RATIO = 0.95
PRIOR_RATIO = 0.5
# Correlation above which two parameters can hardly be told apart.
STRONG_CORRELATION = 0.95
# Standard deviation of the logarithm of a positive parameter (over its value, where no logarithm is estimated) above
# which the data tell its order of magnitude only. Value and standard deviation are no interval then: the truth may lie
# ten standard deviations above.
MAGNITUDE = 0.5


class Verdict(enum.StrEnum):
    """What the data show about one parameter, equal to its text."""

    ESTIMATED = "estimated"  # the data determine it
    PRIOR = "prior"  # the data hardly improve on the prior
    NOT_EXCITED = "not_excited"  # the data hold no information on it: this motion does not excite it
    AT_BOUND = "at_bound"  # the estimate ran into a bound
    FIXED = "fixed"  # held by the user or by the model's table

    __hash__ = str.__hash__  # that of `Enum` takes ten times as long
