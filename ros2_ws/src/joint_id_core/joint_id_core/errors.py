"""The one exception type of this library."""


class JointIdError(ValueError):
    """Misuse or unusable data.

    The message is one line that says what was wrong, where, and what to do. Results that are merely
    poor are no exception: they come back as an `Estimate` whose status says so.
    """
