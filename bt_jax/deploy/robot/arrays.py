"""Arrays that describe a robot's state; a legend of their shapes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["JointRows", "Joints", "Point", "PoseRow"]

Joints = Float[np.ndarray, " joints"]
"""The joints of one arm in chain order, rad."""
JointRows = Float[np.ndarray, "n joints"]
"""Configurations of one arm, one a row."""
PoseRow = Float[np.ndarray, " 7"]
"""Position [m] and quaternion wxyz."""
Point = Float[np.ndarray, " 3"]
"""A position, m."""
