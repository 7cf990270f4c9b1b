"""The whole arm: its description, and what its other joints and links do to one joint. Needs Pinocchio."""
