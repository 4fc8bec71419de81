"""Asynchronous tests."""

import asyncio
import functools


def in_loop(test):
    """Runs an asynchronous test."""

    @functools.wraps(test)
    def run(*arguments, **options):
        asyncio.run(test(*arguments, **options))

    return run
