"""Other ways to fit Model 2 to a recording, one a file, each with one function `fit(data, start, limit_s) -> Fit`."""
