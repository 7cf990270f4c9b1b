"""Checks of a recording before any fit: units, lags, faulty samples, rate."""
