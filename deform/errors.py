"""What a user is told in one sentence instead of a traceback."""


class InputError(ValueError):
    """A mesh, a name or a value that was given cannot be used; the message says which and what would be right."""
