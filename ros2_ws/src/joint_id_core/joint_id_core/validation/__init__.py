"""Prediction of recordings that the fit has not seen."""
