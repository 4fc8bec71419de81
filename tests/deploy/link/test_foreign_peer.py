"""Our link, driven by a controller made of another program's messages."""

import dataclasses
import sys

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import CheckArguments, RunArguments
from bt_jax.deploy.commands.check import check_command
from bt_jax.deploy.commands.run import run_command
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.link.egm import EXTERNAL
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import ARMS, RULES, move, run_for
from tests.helpers.foreign_peer import ForeignPeer
from tests.helpers.rws import served
from tests.helpers.terminal import Terminal

PATIENT = dataclasses.replace(RULES, stale=5.0)  # the peer is a thread of this process


def chain(arm):
    """The joints of a foreign arm in the order of the chain, rad."""
    return np.radians(np.insert(arm.axes, EXTERNAL, arm.seventh))


def test_both_arms_follow_with_their_external_axis():
    ports = free_ports(YUMI.arm_names)
    with served() as (controller, server), ForeignPeer(controller, ports) as peer:
        config = link_config(YUMI, "127.0.0.1", ports, server.server_address[1], motion=True)
        with Irc5Link(config, PATIENT) as link:
            link.start()
            start = {arm: chain(peer.arms[arm]) for arm in ARMS}
            for arm in ARMS:
                np.testing.assert_allclose(link.arm(arm).joints, start[arm], atol=1e-9)
                assert link.arm(arm).running
            move(link, "left", 0.3)
            move(link, "right", -0.2)
            run_for(link, 20.0, until=lambda: not any(link.arm(arm).moving for arm in ARMS))
            run_for(link, 0.5)
            assert link.stopped() is None
            for arm, by in (("left", 0.3), ("right", -0.2)):
                np.testing.assert_allclose(chain(peer.arms[arm]), start[arm] + by, atol=1e-6)
                np.testing.assert_allclose(link.arm(arm).flange.translation, [0.3, 0.1, 0.2])
                steps = np.abs(np.diff(np.radians(peer.arms[arm].told), axis=0))
                assert steps.max() <= max(RULES.speed) * 0.02
            assert link.counters().reordered == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"seventh": False}, "with 6 joints and 0 external ones"),
        ({"host": "127.0.0.2"}, "from 127.0.0.2 and none from 127.0.0.1"),
    ],
    ids=["six axes", "another address"],
)
def test_messages_that_are_of_no_use_are_told_by_link_check_and_run(wrong, told, tmp_path, monkeypatch):
    (tmp_path / "tree.txt").write_text("move(YellowBox, (0, 0, 0.021), KittingBox)\n")
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    ports = free_ports(YUMI.arm_names)
    with served() as (controller, server), ForeignPeer(controller, ports, **wrong):
        port = server.server_address[1]
        with Irc5Link(link_config(YUMI, "127.0.0.1", ports, port), PATIENT) as link:
            run_for(link, 20.0, until=lambda: not any(link.reception(arm).silent for arm in ARMS))
            for arm in ARMS:
                with pytest.raises(UserError, match=told):
                    link.arm(arm)
        arguments = {
            "source": tmp_path / "tree.txt",
            "robot": "127.0.0.1",
            "rws_port": port,
            "ports": tuple(ports.values()),
        }
        console = Terminal("")
        assert check_command(CheckArguments(**arguments), console) == Exit.FAILED
        assert told in " ".join(console.said.split()), console.said
        console = Terminal("")
        with pytest.raises(UserError):
            run_command(RunArguments(**arguments, motion=True, log=tmp_path / "run.jsonl"), console)
        assert told in " ".join(console.said.split()), console.said
