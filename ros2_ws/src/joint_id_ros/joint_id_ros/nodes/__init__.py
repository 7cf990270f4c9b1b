"""The nodes, one per file. Each reads its parameters, passes messages to the library, and publishes the results."""
