"""What every estimator starts from: checked arrays, initial states, step sizes, free runs."""
