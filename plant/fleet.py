"""Many rigs simulated at once: each with its own parameters, all with the same number of drives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.encoder import counted, encoder_angles, recent, recent_values
from plant.errors import BadParameter
from plant.flank import BLOCK
from plant.motion import motion
from plant.rig_record import FleetRecord, FleetState

if TYPE_CHECKING:
    from plant.rig import Rig

Array = NDArray[np.float64]


class Fleet:
    """B rigs simulated together; each gives exactly the same results as alone.

    Raises:
        BadParameter: no rig, or rigs that differ in number of drives, fine step or delay of the encoders.
    """

    def __init__(self, rigs: Sequence[Rig]) -> None:
        """Collect the parameters of the rigs."""
        if not rigs:
            raise BadParameter("A fleet needs at least one rig.")
        first = rigs[0]
        for name in ("drives", "fine_step", "encoder_delay"):
            values = {len(r.drives) if name == "drives" else getattr(r, name) for r in rigs}
            if len(values) > 1:
                raise BadParameter(f"The rigs of a fleet must agree in {name}, but have {sorted(values)}.")
        self.rigs = tuple(rigs)
        self._drives, self._fine_step, self._delay = len(first.drives), first.fine_step, first.encoder_delay
        self._torque_map = np.array([r.torque_map for r in rigs])
        self._shaft_map = np.array([np.copysign(r.motor_ratios, r.torque_map) for r in rigs])
        self._directions = np.array([r.directions for r in rigs])
        self._half_backlash = np.array([r.half_backlash for r in rigs])
        self._stiffness = np.array([[r.flank_stiffness] for r in rigs])
        self._damping = np.array([[r.flank_damping] for r in rigs])
        self._encoder_noise = np.array([r.encoder_noise for r in rigs])
        self._motor_noise = np.array([[r.motor_encoder_noise] for r in rigs])
        self._counts = np.array([r.encoder_counts for r in rigs])
        self._motor_counts = np.array([[r.motor_encoder_counts] for r in rigs])
        self._parameters = np.array([r.parameters for r in rigs])

    def __len__(self) -> int:
        """Number of machines."""
        return len(self.rigs)

    def rest(self, angle: float = 0.0, torques: ArrayLike = 0.0) -> FleetState:
        """All machines at rest, as in `plant.rig.Rig.rest`; torques broadcast to (B, m) [N m]."""
        pressed = np.broadcast_to(np.asarray(torques, dtype=np.float64), self._torque_map.shape)
        states = [rig.rest(angle, own) for rig, own in zip(self.rigs, pressed, strict=True)]
        return FleetState(rows=np.concatenate([state.row() for state in states]))

    def advance(
        self, state: FleetState, torques: ArrayLike, duration: float, disturbance: ArrayLike = 0.0
    ) -> FleetState:
        """The state after pinion torques (B, m) [N m] and load torques (B,) [N m] have been held for `duration` [s].

        If the encoders have a delay, the state is also stored at the instant that they will show at the end. Their
        angles are exact after calls of equal duration; after calls of unequal duration they are interpolated linearly.

        Raises:
            BadParameter: a torque or the duration is not a usable number.
        """
        count = len(self)
        pinion, push = np.asarray(torques, dtype=np.float64), np.asarray(disturbance, dtype=np.float64)
        if pinion.shape != (count, self._drives) or not (np.all(np.isfinite(pinion)) and np.all(np.isfinite(push))):
            raise BadParameter(f"Rig: the torques must be {self._drives} finite numbers [N m], not {torques!r}.")
        if not 0.0 < duration < np.inf:
            raise BadParameter(f"Rig: the duration must be above zero and finite, not {duration!r} s.")
        command, pushes = pinion * self._torque_map, np.broadcast_to(push, (count,))
        rows = state.rows.copy()
        rows[:, 2 + 2 * self._drives : 2 + 3 * self._drives] = np.inf  # no least contact torque yet
        late = self._delay % duration
        if min(late, duration - late) < 1e-9 * duration:
            late = 0.0
        past = state.trail
        if self._delay and not past:
            past = ((0.0, encoder_angles(rows)),)
        if late:
            rows = self._moved(rows, command, pushes, duration - late)
            past = ((late - duration, encoder_angles(rows)), *past)
        rows = self._moved(rows, command, pushes, late or duration)
        if self._delay and not late:
            past = ((-duration, encoder_angles(rows)), *past)
        return FleetState(rows=rows, trail=recent(past, duration, self._delay))

    def contact_torques(self, state: FleetState) -> Array:
        """(B, m) torque of each required flank [N m], output side; positive: pushing in the required direction."""
        return self._contact_torques(state.rows)

    def _contact_torques(self, rows: Array) -> Array:
        """(..., B, m) contact torques of states (..., B, S)."""
        m = self._drives
        relative_angle, rate = rows[..., 2 : 2 + m] - rows[..., :1], rows[..., 2 + m : 2 + 2 * m] - rows[..., 1:2]
        pressed = np.maximum(np.abs(relative_angle) - self._half_backlash, 0.0)
        push = self._stiffness * pressed + self._damping * np.sign(relative_angle) * rate
        passed = np.sign(relative_angle) * np.where(pressed > 0.0, np.maximum(push, 0.0), 0.0)
        return np.asarray(self._directions * passed)

    def minimum_contact_torques(self, state: FleetState) -> Array:
        """(B, m) least torque of each required flank during the last advance [N m], as in `RigState`."""
        return state.rows[:, 2 + 2 * self._drives : 2 + 3 * self._drives]

    def measure(self, state: FleetState, noise: ArrayLike = 0.0) -> Array:
        """(B,) load angles measured by their encoders [rad], with noise (B,) in standard deviations."""
        return self._load_measurements(recent_values(state.rows, state.trail, self._delay), noise)

    def motor_angles(self, state: FleetState, noise: ArrayLike = 0.0) -> Array:
        """(B, m) motor shaft angles measured by their encoders [rad], with noise (B, m) in standard deviations."""
        return self._motor_measurements(recent_values(state.rows, state.trail, self._delay), noise)

    def _load_measurements(self, angles: Array, noise: ArrayLike) -> Array:
        """(..., B) load measurements for angles (..., B, 1 + m) as from `plant.encoder.recent_values`."""
        return counted(angles[..., 0] + self._encoder_noise * np.asarray(noise), self._counts)

    def _motor_measurements(self, angles: Array, noise: ArrayLike) -> Array:
        """(..., B, m) motor measurements for angles (..., B, 1 + m) as from `plant.encoder.recent_values`."""
        turned = self._shaft_map * angles[..., 1:]
        return counted(turned + self._motor_noise * np.asarray(noise), self._motor_counts)

    def run(
        self,
        torques: ArrayLike,
        sample_time: float,
        seeds: Sequence[int],
        *,
        start: FleetState | None = None,
        disturbance: ArrayLike = 0.0,
    ) -> FleetRecord:
        """Simulate pinion torques (T, B, m) [N m], each row held for `sample_time` [s], and record.

        Args:
            torques: (T, B, m) pinion torques [N m].
            sample_time: [s].
            seeds: (B,) of the encoders' noise.
            start: first state; at rest at angle zero by default.
            disturbance: torque on the loads [N m], broadcast to (T, B).

        Raises:
            BadParameter: the torques have another shape, or a number is not finite.
        """
        commands, count, m = np.asarray(torques, dtype=np.float64), len(self), self._drives
        if commands.ndim != 3 or commands.shape[1:] != (count, m) or not np.all(np.isfinite(commands)):
            raise BadParameter(f"Rig: the torques must be finite and of shape (T, {count}, {m}), not {commands.shape}.")
        if len(seeds) != count:
            raise BadParameter(f"Rig: there must be a seed for each of {count} machines, not {len(seeds)}.")
        length = len(commands)
        pushes = np.broadcast_to(np.asarray(disturbance, dtype=np.float64), (length, count))
        noise = np.stack([np.random.default_rng(seed).standard_normal(length) for seed in seeds], axis=1)
        shake = np.stack([_motor_noise(seed, length, m) for seed in seeds], axis=1)
        state = self.rest() if start is None else start
        rows = np.empty((length + 1, *state.rows.shape))
        shown = np.empty((length, count, 1 + m))
        rows[0] = state.rows
        for k, command in enumerate(commands):
            shown[k] = recent_values(state.rows, state.trail, self._delay)
            state = self.advance(state, command, sample_time, pushes[k])
            rows[k + 1] = state.rows
        least, given = np.split(rows[1:, :, 2 + 2 * m :], 2, axis=2)
        return FleetRecord(
            time=np.arange(length, dtype=np.float64) * sample_time,
            torques=commands.copy(),
            angle=self._load_measurements(shown, noise),
            true_angle=rows[:-1, :, 0].copy(),
            velocity=rows[:-1, :, 1].copy(),
            motor_angles=self._motor_measurements(shown, shake),
            given_torques=given / self._torque_map,
            contact_torques=self._contact_torques(rows[:-1]),
            minimum_contact_torques=least + 0.0,  # no minus zero
            end=state,
        )

    def _moved(self, rows: Array, command: Array, pushes: Array, duration: float) -> Array:
        blocks = max(1, int(np.ceil(duration / (self._fine_step * BLOCK) - 1e-9)))
        step = duration / (blocks * BLOCK)
        return motion(self._drives).advance(rows, command, pushes, self._parameters, blocks, step)


def _motor_noise(seed: int, length: int, drives: int) -> Array:
    """(T, m) noise independent of the load encoder's."""
    return np.random.default_rng((seed, 1)).standard_normal((length, drives))
