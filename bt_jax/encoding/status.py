"""What a node of a tree returns."""

import enum

__all__ = ["Status"]


class Status(enum.IntEnum):
    """What a node returns."""

    FAILURE = 0
    SUCCESS = 1
    RUNNING = 2
