from bt_jax.app.state.bus import Bus, Message


def test_subscribers_hear_of_their_topic_until_they_leave_whatever_others_do(capsys):
    bus, heard = Bus(), []
    bus.subscribe("task", lambda: 1 / 0)
    leave = bus.subscribe("task", lambda: heard.append("task"))
    bus.subscribe("news", lambda: heard.append(bus.news))
    bus.changed("task")
    bus.say("Finished.", "success")
    leave()
    bus.changed("task")
    assert heard == ["task", Message("Finished.", "success")]
    assert "ZeroDivisionError" in capsys.readouterr().err
