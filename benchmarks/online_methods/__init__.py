"""Other online methods on the signals of a UR robot; `benchmarks/online_peers.py` compares them."""
