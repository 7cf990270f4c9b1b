"""Several recordings of one joint in one estimate."""
