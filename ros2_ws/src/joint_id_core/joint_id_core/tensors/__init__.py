"""The RK4 network for many parameter sets and records at once, on tensors of torch: on a GPU, or on the CPU."""
