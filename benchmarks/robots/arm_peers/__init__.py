"""Other ways to fit a whole arm, beside ours, on the same logs."""
