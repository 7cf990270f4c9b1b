"""Run lengths of the drift monitor: of its control chart alone, and through the online identifier."""
