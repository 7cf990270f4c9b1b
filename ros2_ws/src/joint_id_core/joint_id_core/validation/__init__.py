"""Validation: prediction of recordings that were not used in the fit."""

from joint_id_core.validation.prediction import held_out as held_out
