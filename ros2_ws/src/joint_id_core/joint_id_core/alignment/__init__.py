"""Convert the raw topics of a robot to aligned samples: join messages by stamp, convert units, filter."""
