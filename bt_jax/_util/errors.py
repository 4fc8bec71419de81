"""The one exception that a user is meant to read."""

__all__ = ["UserError"]


class UserError(Exception):
    """Something the user can fix; the message is one sentence that ends with the remedy.

    The command lines print it without a traceback and exit with code 2.
    """
