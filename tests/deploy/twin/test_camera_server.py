import threading
import time

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.camera import CameraError, UvcCamera
from bt_jax.deploy.twin.camera_server import CameraServer

SIZE = (240, 320)


def ends(camera):
    """Does the camera say within 10 s that it sends no more?"""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            camera.read()
        except CameraError:
            return True
        time.sleep(0.05)
    return False


def test_images_are_seen_as_from_any_network_camera():
    sent = []
    with CameraServer() as server:
        closing = threading.Event()

        def feed():
            while not closing.wait(0.02):
                if server.watched:
                    sent.append(np.full((*SIZE, 3), 10 * (1 + len(sent) % 20), np.uint8))
                    sent[-1][:, :100, 0] = 255
                    server.show(sent[-1])

        thread = threading.Thread(target=feed)
        thread.start()
        try:
            assert not server.watched
            camera = UvcCamera(server.address, np.eye(3), np.zeros(5), width=SIZE[1], height=SIZE[0])
            seen = []
            while len(seen) < 5:
                frame = camera.read()
                if not seen or frame.time > seen[-1].time:
                    seen.append(frame)
            for frame in seen:
                assert min(np.abs(frame.image.astype(int) - image).max() for image in sent) < 12, "but for JPEG"
                assert frame.time == pytest.approx(time.monotonic(), abs=5.0)
        finally:
            closing.set()
            thread.join()
    assert ends(camera)
    camera.close()


def test_a_port_that_is_taken_is_told():
    with CameraServer() as server:
        port = int(server.address.rstrip("/").rsplit(":", 1)[1])
        with pytest.raises(UserError, match=f"{port} cannot be used"):
            CameraServer(port)
