"""The physics-informed network of the paper (H-PINN). Needs torch."""
