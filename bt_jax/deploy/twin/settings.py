"""The numbers of the twin: how far it is from a perfect cell, and how long its controller waits, and for what."""

from __future__ import annotations

import dataclasses
import math

from bt_jax._util.errors import UserError

__all__ = ["TIMING", "ControllerTiming", "Realism"]

Vec3 = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Realism:
    """What keeps a real cell from being perfect. The defaults are realistic: beside each stands its source, or that it is an
    estimate. What varies is drawn from the seed of the layout. One thing is left to the commands: how fast the arms are
    asked to move, at reduced speed on a real robot and at the planner's own pace in the twin."""

    # The size and the rate of many USB cameras: at this size an uncompressed image over USB 2 leaves 10 to 15 a second.
    width: int = 1280
    """of the camera's images, px"""
    height: int = 960
    """of the camera's images, px"""
    rate: float = 15.0
    """images a second"""
    # Blurred contrast falls to one half at 0.187 / blur line pairs a pixel: here 0.27, and tests of lenses call 0.25 to 0.33
    # sharp.
    blur: float = 0.7
    """of lens and focus, standard deviation, px"""
    # 40 dB, which 10,000 electrons a pixel give (shot noise, EMVA 1288).
    noise: float = 2.5
    """of every pixel, standard deviation, of 255"""
    exposure: float = 0.0
    """of the images, stops: below 0 too dark, above too bright"""
    # Estimate, for lamps on alternating current.
    flicker: float = 0.03
    """share by which the brightness differs from image to image"""
    # Estimates: a fifth of what `calibrate base` accepts, and as much again at a distance of 0.5 m.
    camera_error: float = 0.001
    """m by which the calibration is wrong about the camera's place"""
    camera_tilt: float = 0.002
    """rad by which the calibration is wrong about its direction"""
    camera_moved: Vec3 = (0.0, 0.0, 0.0)
    """m by which the camera was moved since it was calibrated, in the robot's base frame"""
    camera_turned: Vec3 = (0.0, 0.0, 0.0)
    """rad by which it was turned since, about the axes of that frame"""
    # ABB states a control lag of 10 to 20 ms (application manual 3HAC073319); the lag of the filter (20 Hz in BtJax) and of
    # the position loop is an estimate.
    egm_delay: float = 0.02
    """s from a setpoint to the first motion"""
    egm_lag: float = 0.05
    """s by which the motion then trails behind the setpoints"""
    # None, so that a simulated run may move at the planner's own pace, 45 % of what the joints can: faster than the reduced
    # speed at which `run` moves a real robot, 0.2. BtJax allows `link.settings.EGM_SPEED`, and so does `twin --serve`.
    egm_speed: float = math.inf
    """rad/s at which EGM lets a joint turn"""
    # Estimate: BtJax ends one session after a look at the gripper (0.05 s), and sets up the next.
    egm_restart: float = 0.1
    """s of silence between telling the position and guided motion; the messages then count from 1 again"""
    # Estimate: one look of BtJax at the target (0.05 s), and the gripper's own controller.
    gripper_delay: float = 0.2
    """s from a command to the fingers' motion"""
    # As BtJax does it; the Smart Gripper reaches 0.025 m/s (product manual 3HAC054949).
    gripper_reading: float = 0.05
    """s between two readings of the fingers"""
    finger_speed: float = 0.02
    """m/s of each finger"""
    # Found by a public client of the IRC5; the time of an answer is an estimate.
    requests: float = 20.0
    """requests a second that Robot Web Services answer, with 503 beyond"""
    request_delay: float = 0.02
    """s that such an answer takes"""
    # Estimate: ISO/TS 15066 allows 140 N on a hand, and a robot made for contact stays well below.
    contact: float = 60.0
    """N at the hand at which the controller's motion supervision stops the arms"""

    @staticmethod
    def perfect() -> Realism:
        """Return a cell without any of it: sharp images of 640 x 480, arms that follow at once, no limits."""
        return Realism(
            width=640,
            height=480,
            rate=math.inf,
            blur=0.0,
            noise=0.0,
            flicker=0.0,
            camera_error=0.0,
            camera_tilt=0.0,
            egm_delay=0.0,
            egm_lag=0.0,
            egm_restart=0.0,
            gripper_delay=0.0,
            gripper_reading=0.0,
            finger_speed=0.025,
            requests=math.inf,
            request_delay=0.0,
            contact=math.inf,
        )

    def scaled(self, factor: float) -> Realism:
        """Return a cell that is `factor` times as bad: errors and delays times the factor, speeds and limits divided by it.
        The size of the images stays."""
        changes: dict[str, float | Vec3] = {name: factor * getattr(self, name) for name in _ERRORS}
        changes |= {name: getattr(self, name) / factor for name in _LIMITS}
        for name in ("camera_moved", "camera_turned"):
            x, y, z = getattr(self, name)
            changes[name] = (factor * x, factor * y, factor * z)
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def logged(self) -> dict[str, float | int | Vec3 | None]:
        """Return it for a log; None where there is no limit."""
        return {name: None if value == math.inf else value for name, value in dataclasses.asdict(self).items()}

    def check(self) -> None:
        """Raise UserError for values that cannot be."""
        if not (64 <= self.width <= 8192 and 64 <= self.height <= 8192):
            raise UserError(f"images of {self.width} x {self.height} pixels cannot be drawn; choose 64 to 8192 a side")
        for name in (*_ERRORS, *_LIMITS):
            value = getattr(self, name)
            if name in _LIMITS and not value > 0:
                raise UserError(f"{name} is {value}; choose more than 0")
            if name in _ERRORS and not (math.isfinite(value) and (value >= 0 or name == "exposure")):
                raise UserError(f"{name} is {value}; choose a number from 0 on")
        if not all(map(math.isfinite, (*self.camera_moved, *self.camera_turned))):
            raise UserError("camera_moved and camera_turned must be three numbers each; choose others")


_ERRORS = (
    "blur",
    "noise",
    "exposure",
    "flicker",
    "camera_error",
    "camera_tilt",
    "egm_delay",
    "egm_lag",
    "egm_restart",
    "gripper_delay",
    "gripper_reading",
    "request_delay",
)
_LIMITS = ("rate", "egm_speed", "finger_speed", "requests", "contact")


@dataclasses.dataclass(frozen=True)
class ControllerTiming:
    """How long the twin's controller waits for its client, and its handle for the process, in seconds."""

    process: float = 30.0  # for the process to come up and to answer its handle
    silence: float = 0.5  # without a setpoint after which the controller ends EGM
    setpoint: float = 1.0  # by the clock for which lock-step waits for a setpoint
    faulty: float = 0.01  # the same where setpoints may be lost
    patience: float = 0.04  # simulated, of silence after which lock-step waits no more
    catch_up: int = 12  # cycles that are made up for after a delay; the rest is lost


TIMING = ControllerTiming()
