"""What is right and what is wrong in an answer."""

LONGEST = 1000
"""Characters of a message."""


class WrongError(Exception):
    """What was done is wrong, though no error was reported."""


def is_single(message: str, quoted: int = 0) -> bool:
    """Whether a message is one line without commands for a terminal, says something, and no more than it has to.

    Of what the user said it may quote so many characters.
    """
    return message.strip() != "" and message.isprintable() and len(message) < LONGEST + 4 * quoted
