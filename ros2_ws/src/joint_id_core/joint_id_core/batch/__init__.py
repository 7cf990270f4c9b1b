"""Many recordings, one table: every joint of every recording is fitted, on all cores or on a cluster."""
