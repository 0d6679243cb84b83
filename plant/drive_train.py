"""Common base of the drive trains of one or two drives, given by tooth counts or by ratios only."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.renamed import Renamed

Array = NDArray[np.float64]


class DriveTrain(ABC):
    """m drives, two or one, on one load.

    With theta the angle of the load, phi_i and xi_i the angle and torque of the shaft in front of the final mesh (the
    pinion) and b_i the torque on the load for one newton metre there:

        phi_i = b_i theta,    tau = sum_i b_i xi_i                    (equations 1 and 2 of the drive/anti-drive paper)

    Of two drives, drive 1 pushes the load backward and drive 2 pushes it forward, which keeps both meshes in contact.
    On a linear axis b is a force per torque [N/(N m)], and theta a position.
    """

    @property
    @abstractmethod
    def torque_map(self) -> Array:
        """(m,) b: torque on the load for one newton metre of each pinion."""

    @property
    @abstractmethod
    def pre_reductions(self) -> Array:
        """(m,) turns of each motor for one turn of its pinion, above zero."""

    @property
    def drives(self) -> int:
        """Number of drives m."""
        return self.torque_map.size

    @property
    def directions(self) -> tuple[int, ...]:
        """(m,) required sign of each drive's torque, +1 or -1; of a single drive, the sign of forward."""
        forward = np.sign(self.torque_map).astype(int).tolist()
        return (-forward[0], forward[1]) if len(forward) == 2 else tuple(forward)

    @property
    def mesh_ratios(self) -> Array:
        """(m,) magnitudes of b."""
        return np.abs(self.torque_map)

    @property
    def motor_ratios(self) -> Array:
        """(m,) turns of each motor for one turn of the load, without the sign."""
        return self.pre_reductions * self.mesh_ratios

    @property
    def ratio(self) -> float:
        """Turns of motor 1 for one turn of the load (the paper's total gear reduction)."""
        return float(self.motor_ratios[0])

    @property
    def angle_map(self) -> Array:
        """(m,) pinion angles for one radian of the load, equation (1)."""
        return self.torque_map

    @property
    def null_vector(self) -> Array:
        """(m,) pinion torques that put no torque on the load (equation 3), the larger one 1 N m; zero of one drive."""
        if self.drives == 1:
            return np.zeros(1)
        return np.array(self.directions) * self.mesh_ratios[::-1] / np.max(self.mesh_ratios)

    def particular(self, torque: ArrayLike) -> Array:
        """Pinion torques of least norm for a torque on the load, the first term of equation (3).

        Args:
            torque: on the load [N m], any shape (...).

        Returns:
            Pinion torques [N m], shape (..., m).
        """
        b = self.torque_map
        return np.asarray(torque, dtype=np.float64)[..., None] * (b / (b @ b))

    def pinion_torques(self, torque: ArrayLike, preload: ArrayLike) -> Array:
        """Pinion torques for a torque on the load and a preload, equation (3).

        Args:
            torque: on the load [N m], any shape (...).
            preload: lambda, in units of the null vector, shape that broadcasts with `torque`.

        Returns:
            Pinion torques [N m], shape (..., m).
        """
        return self.particular(torque) + np.asarray(preload, dtype=np.float64)[..., None] * self.null_vector

    def output_torque(self, torques: ArrayLike) -> Array:
        """Torque on the load [N m], shape (...), of pinion torques [N m], shape (..., m), equation (2)."""
        return np.asarray(np.asarray(torques, dtype=np.float64) @ self.torque_map)

    follower_torque = Renamed("output_torque")

    def load_speed(self, motor_speed: float) -> float:
        """Speed of the load at a speed of motor 1, in the same unit and without the sign of the final mesh."""
        return motor_speed / self.ratio
