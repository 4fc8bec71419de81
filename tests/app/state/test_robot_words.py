import pytest

from bt_jax.app.plain_words import Words
from bt_jax.app.processes.twin_messages import Ended, Tick
from bt_jax.app.state.robot_words import age_words, doing, outcome_words, waiting_for
from bt_jax.tasks import load_task

WORDS = Words(load_task("yumi_stack"))


def tick(phase="acting", action="pick(YellowBox)", *, holding=None, doubts=(), away=(), ages=None):
    return Tick(1.0, None, phase, action, holding, list(doubts), list(away), ages or {})


@pytest.mark.parametrize(
    ("shown", "does", "waits"),
    [
        (tick(), "Pick up YellowBox", ""),
        (tick("committed"), "Pick up YellowBox: not to be broken off now", ""),
        (tick(doubts=["BlueBox is not seen"]), "Pick up YellowBox", "Notices: BlueBox is not seen."),
        (
            tick("looking", None, doubts=["BlueBox is not seen"]),
            "The arms get out of the camera's way",
            "Waits until it sees more: BlueBox is not seen.",
        ),
        (tick("settling", None), "The camera looks at what has changed", ""),
        (
            tick("pausing", None, doubts=["the picture is too dark"]),
            "The arms pause",
            "Waits until the picture is right again: the picture is too dark.",
        ),
        (tick("waiting", None), "The tree wants nothing more", "Waits, to be sure that it stays so."),
    ],
)
def test_what_it_does_and_waits_for_is_said(shown, does, waits):
    assert doing(WORDS, shown) == does
    assert waiting_for(shown) == waits


def test_what_is_known_of_an_object_is_said():
    shown = tick(holding="A", away=["B"], ages={"A": 3.0, "B": 9.0, "C": 0.2, "D": 4.2, "E": None})
    assert [age_words(shown, name) for name in "ABCDE"] == [
        "in the hand",
        "taken away",
        "seen",
        "not seen for 4 s",
        "not seen yet",
    ]


def test_how_it_ended_is_said():
    assert outcome_words(Ended("interrupted", 3.0, solved=False, interrupted=True)) == "Stopped: the arms rest."
    done = Ended("the tree has succeeded", 41.3, solved=True, interrupted=False)
    assert outcome_words(done) == "Done after 41 s: the tree has succeeded."
    failed = Ended("the time is up", 240.0, solved=False, interrupted=False)
    assert outcome_words(failed) == "Ended without success after 240 s: the time is up."
