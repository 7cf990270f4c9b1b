"""The nodes, one a file: each reads its parameters, hands messages to the library, and publishes what comes back."""
