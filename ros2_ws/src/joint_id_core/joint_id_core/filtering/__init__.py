"""The 4th-order Butterworth differentiator, for whole records and for streams."""
