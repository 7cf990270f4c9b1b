"""Parts that all estimators share: checked arrays, initial states, step sizes, free runs."""
