"""What an estimator returns, for programs and for people."""
