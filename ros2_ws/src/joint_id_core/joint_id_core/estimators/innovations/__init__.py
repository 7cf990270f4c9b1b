"""The default estimator: maximum likelihood with the innovations form of the RK4 network."""
