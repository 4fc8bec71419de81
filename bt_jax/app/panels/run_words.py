"""What happens while a tree runs, in words."""

from __future__ import annotations

from bt_jax.app.plain_words import Words
from bt_jax.app.state.player import Player
from bt_jax.app.state.studio import Studio
from bt_jax.mjx_env.episodes.rules import Ending

__all__ = ["said", "verdict"]

ENDINGS = {
    Ending.SUCCESS: "The tree says that it is done.",
    Ending.FAILURE: "The tree has failed: one of its actions is impossible here.",
    Ending.TIMEOUT: "The time is up: the tree has used all its ticks.",
    Ending.BROKEN: "The simulation diverged; press Start over.",
}


def said(words: Words, player: Player) -> str:
    """Say what happened last."""
    now = player.now
    ticks = sum(each.tick is not None and each.moved is None for each in player.snapshots[: player.at + 1])
    if now.moved is not None:
        return f"After tick {ticks} you moved {now.moved}."
    if now.tick is None:
        return "The beginning: press Play."
    command = now.tick.command
    done = "nothing to do" if command is None else words(command)
    return ". ".join([f"Tick {ticks}: {done}", *now.tick.troubles])


def verdict(studio: Studio, player: Player) -> str:
    newer = studio.playing.tree is not None and studio.playing.tree != player.tree
    hint = "Evolution has found a better tree meanwhile; press Start over to run it." if newer else ""
    return f"{_ended(player)} {hint}".strip()


def _ended(player: Player) -> str:
    """Say how the episode has ended, nothing if it goes on."""
    if player.ending == Ending.OPEN:
        return ""
    there = all(player.in_place)
    if player.ending == Ending.SUCCESS:
        return (
            f"{ENDINGS[player.ending]} {'Everything is where it should be.' if there else 'But not all is in place.'}"
        )
    return ENDINGS[player.ending]
