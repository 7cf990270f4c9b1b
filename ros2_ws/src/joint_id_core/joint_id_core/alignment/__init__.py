"""From the raw topics of a robot to aligned samples: messages joined by their stamps, and what their numbers mean."""
