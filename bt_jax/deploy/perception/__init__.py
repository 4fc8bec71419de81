"""From a camera's images to poses of boxes and kit: calibration, markers, detection, tracking."""
