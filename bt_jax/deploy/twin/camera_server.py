"""The twin's camera for other programs: JPEG images over HTTP, one after the other, as network cameras send them."""

from __future__ import annotations

import http.server
import threading

import cv2

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.arrays import ColorImage

__all__ = ["CameraServer"]

BOUNDARY = "image"
QUALITY = 95  # of the JPEG images
PATIENCE = 1.0  # seconds between two looks whether the server was closed


class CameraServer:
    """Serve images on the loopback interface, at `address`. Use it as a context manager."""

    def __init__(self, port: int = 0) -> None:
        """Take a port, 0 for any free one. Raise UserError if it is taken."""
        self._changed = threading.Condition()
        self._image, self._number, self._watching = b"", 0, 0
        self._closed = False
        handler = type("Handler", (_Handler,), {"camera": self})
        try:
            self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
        except OSError as error:
            raise UserError(
                f"the TCP port {port} cannot be used ({error.strerror}); choose another --camera-port"
            ) from error
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}/"

    def __enter__(self) -> CameraServer:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed = True
        self._server.shutdown()
        self._server.server_close()

    @property
    def watched(self) -> bool:
        """Does anybody look?"""
        return self._watching > 0

    def show(self, image: ColorImage) -> None:
        """Send an image to all that look."""
        encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        with self._changed:
            self._image, self._number = encoded.tobytes(), self._number + 1
            self._changed.notify_all()

    def next_image(self, after: int) -> tuple[bytes, int]:
        """Wait for an image newer than number `after`; return it as JPEG, no bytes once the server is closed, and its
        number."""
        with self._changed:
            while self._number <= after:
                if self._closed:
                    return b"", after
                self._changed.wait(PATIENCE)
            return self._image, self._number

    def look(self, by: int) -> int:
        """Count somebody who begins to look (1) or ends (-1); return the number of the newest image."""
        with self._changed:
            self._watching += by
            return self._number


class _Handler(http.server.BaseHTTPRequestHandler):
    camera: CameraServer

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.end_headers()
        number = self.camera.look(1)
        try:
            while True:
                image, number = self.camera.next_image(number)
                if not image:
                    return
                self.wfile.write(
                    f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n".encode()
                )
                self.wfile.write(image + b"\r\n")
        except OSError:  # whoever looked is gone
            return
        finally:
            self.camera.look(-1)

    def log_message(self, *_: object) -> None:
        """Log nothing."""
