"""The one exception type of this library."""


class JointIdError(ValueError):
    """Misuse or unusable data.

    The message is one line that says what was wrong, where, and what to do. A poor result raises no exception: the
    status of its `Estimate` says so.
    """
