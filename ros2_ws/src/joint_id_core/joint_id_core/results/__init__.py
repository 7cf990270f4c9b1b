"""The result of an estimator, as data and as text."""

from joint_id_core.results.estimate import Estimate as Estimate
from joint_id_core.results.estimate import ParameterEstimate as ParameterEstimate
from joint_id_core.results.estimate import Status as Status
from joint_id_core.results.estimate import Verdict as Verdict
