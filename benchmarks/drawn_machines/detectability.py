"""Detectability of an effect in a log: lambda, from its torque relative to the noise and the unmodelled torque.

It is approximate and uses no code of the diagnosis. Torques of the samples are compared in the frequency domain, with
the spectrum of white measurement noise as a torque and that of the unmodelled torque; inertia, gravity, viscous
friction and all other effects of the log are projected out.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from drawn_machines.hidden import Basis
from drawn_machines.motion import Array, Motion
from drawn_machines.servo import Machine

TELLING = 60.0  # lambda from which an effect of the catalogue should be detected

FLOOR = 1e-4  # fraction of the torque: white noise at the level of numerical errors


class Seen:
    """Torques along a log, (T,) each, and the noise for their detectability."""

    def __init__(self, machine: Machine, moved: Basis, motions: list[Motion], torque_noise: float) -> None:
        self.machine, self.moved = machine, moved
        self.torque_noise = float(np.hypot(torque_noise, FLOOR * moved.level))
        self.lengths = [motion.time.size for motion in motions]
        names = motions[0].torques
        self.torques = {name: np.concatenate([motion.torques[name] for motion in motions]) for name in names}
        error = np.concatenate([motion.error for motion in motions])
        command = np.concatenate([motion.command for motion in motions])
        self.commanded = command * machine.kp if machine.kp else command
        if "encoder_eccentricity" in machine.effects:
            self.torques["encoder_eccentricity"] = self._as_torque(error)
        for name in {"sensor_lag", "actuator_lag"} & set(machine.effects):  # equivalent in series with a linear plant
            self.torques[name] = self.lagged(machine.effects[name]["time_constant"] / moved.sample_time)

    def by_run(self, values: Array) -> list[Array]:
        """Split values (T, ...) by run."""
        return np.split(values, np.cumsum(self.lengths)[:-1])

    def lagged(self, samples: float) -> Array:
        """Torque that a first-order lag adds to the command [N m]."""
        keep = float(np.exp(-1.0 / samples))
        parts = [
            lfilter([1.0 - keep], [1.0, -keep], part, zi=[keep * part[0]])[0] - part
            for part in self.by_run(self.commanded)
        ]
        return np.concatenate(parts)

    def _as_torque(self, error: Array) -> Array:
        """The torque equivalent to a measurement error."""
        dt, parts = self.moved.sample_time, []
        for part in self.by_run(error):
            rate = np.gradient(part, dt)
            parts.append(self.machine.inertia * np.gradient(rate, dt) + self.machine.viscous_friction * rate)
        return np.concatenate(parts)

    @cached_property
    def _weights(self) -> list[Array]:
        """Inverse standard deviation of the noise, by frequency and run."""
        dt, found = self.moved.sample_time, []
        for rest in self.by_run(self.torques["rest"]):
            n = rest.size
            omega2 = np.maximum((2.0 - 2.0 * np.cos(2.0 * np.pi * np.fft.rfftfreq(n))), (2.0 * np.pi / n) ** 2) / dt**2
            machine = self.machine
            stiffness = machine.inertia * omega2 + machine.gravity * 0.7
            noise = n * self.moved.noise**2 * (stiffness**2 + omega2 * machine.viscous_friction**2)
            power = np.abs(np.fft.rfft(rest * np.hanning(n))) ** 2 * 8.0 / 3.0
            width = max(3, n // 200)
            smooth = np.convolve(np.pad(power, width, mode="edge"), np.ones(2 * width + 1) / (2 * width + 1), "valid")
            found.append(1.0 / np.sqrt(noise + smooth + n * self.torque_noise**2))
        return found

    def whitened(self, columns: Array) -> Array:
        """(F, m) whitened columns (T, m)."""
        parts = []
        for part, weight in zip(self.by_run(columns), self._weights, strict=True):
            window = np.hanning(part.shape[0])[:, None] * np.sqrt(8.0 / 3.0)
            seen = np.fft.rfft(part * window, axis=0) * weight[:, None] * np.sqrt(2.0)
            parts += [seen.real, seen.imag]
        return np.concatenate(parts)

    def base(self, but: str) -> Array:
        """(T, m) regressors of a model without one effect: the rigid body and the other effects."""
        b = self.moved
        others = [self.torques[name] for name in self.machine.effects if name != but]
        return np.column_stack((b.acceleration, np.cos(b.angle), b.velocity, *others))

    def visible(self, name: str, beside: Array | None = None) -> float:
        """lambda of an effect beyond the rest of the model, and beyond further columns (T, m)."""
        columns = self.base(name) if beside is None else np.column_stack((self.base(name), beside))
        wanted = self.whitened(self.torques[name][:, None])[:, 0]
        known = self.whitened(columns)
        size = np.linalg.norm(known, axis=0)
        known = known[:, size > 0.0] / size[size > 0.0]
        left = wanted - known @ np.linalg.lstsq(known, wanted, rcond=1e-10)[0]
        return float(left @ left)
