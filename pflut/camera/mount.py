"""How a camera sits on the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.camera.fields import angle, check_fields
from pflut.geometry import FloatArray


@dataclass(frozen=True)
class Mount:
    """The camera's orientation and height in the robot frame.

    The camera's own frame is x forward, y left, z up (REP 103), so that a mount of zeros is a
    level camera that looks where the robot drives. The rotation robot <- camera is
    ``Rz(yaw) Ry(pitch) Rx(roll)``, right-handed about the robot's axes.

    Parameters
    ----------
    yaw : float
        Radians, counter-clockwise seen from above: positive looks to the left.
    pitch : float
        Radians about y (left). Positive looks down, as REP 103 has it.
    roll : float
        Radians about x (forward). Positive leans the camera to the right.
    height : float
        Metres above the floor. Nothing planar needs it; it is kept for drawing and for scale.

    Raises
    ------
    ValueError
        If a value is not a finite number.
    """

    yaw: float = angle(0.0)
    pitch: float = angle(0.0)
    roll: float = angle(0.0)
    height: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def is_aligned(self) -> bool:
        """Whether the camera's axes are the robot's."""
        return self.yaw == 0.0 and self.pitch == 0.0 and self.roll == 0.0

    def rotation(self) -> FloatArray:
        """Give the rotation matrix robot <- camera.

        Returns
        -------
        ndarray of shape (3, 3)
            ``v_robot = rotation @ v_camera``.
        """
        cy, sy = np.cos(self.yaw), np.sin(self.yaw)
        cp, sp = np.cos(self.pitch), np.sin(self.pitch)
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        return np.asarray(about_z @ about_y @ about_x)
