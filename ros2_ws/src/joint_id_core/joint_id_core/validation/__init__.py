"""Prediction of recordings that the fit has not seen."""

from joint_id_core.validation.prediction import held_out as held_out
