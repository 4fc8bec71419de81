import dataclasses

from bt_jax.app.state.steps import STEPS, advice, done


def test_a_page_that_was_just_opened_leads_on_from_every_step(studio):
    assert done(studio) == {"task"}
    for step in STEPS:
        found = advice(studio, step)
        assert found.step != step
        assert found.sentence.endswith(".")
    assert advice(studio, "task").ready
    assert not advice(studio, "evolve").ready


def test_a_task_without_targets_is_not_done(studio):
    studio.edit_task(dataclasses.replace(studio.edited.task, targets=()))
    assert "task" not in done(studio)
    assert not advice(studio, "task").ready


def test_what_fails_too_often_is_not_found(studio):
    studio.evolution.stage = "finished"
    for rate, found in ((0.4, False), (1.0, True)):
        studio.evolution.result = {"success_rate": rate, "test_layouts": 100}
        assert ("evolve" in done(studio)) == found
        assert advice(studio, "evolve").step == ("run" if found else "demonstrate")
