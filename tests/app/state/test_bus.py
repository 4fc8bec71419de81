from bt_jax.app.state.bus import Bus


def test_subscribers_hear_of_their_topic_until_they_leave_whatever_others_do(capsys):
    bus, heard = Bus(), []
    bus.subscribe("task", lambda: 1 / 0)
    leave = bus.subscribe("task", lambda: heard.append("task"))
    bus.subscribe("message", lambda: heard.append(bus.message))
    bus.changed("task")
    bus.say("Saved.")
    leave()
    bus.changed("task")
    assert heard == ["task", "Saved."]
    assert "ZeroDivisionError" in capsys.readouterr().err
