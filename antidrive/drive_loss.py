"""The closed loop when one drive fails: the other one drives the load alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from allocation import Allocator, least_effort
from mpc import ClosedLoopResult, Controller
from plant.rig import Rig

Array = NDArray[np.float64]


def loop_with_drive_loss(
    controller: Controller,
    rig: Rig,
    reference: Array,
    pushes: Array,
    *,
    drive: int,
    time: float,
    seed: int,
    detection: float = 0.0,
    after_sample: Callable[[], None] | None = None,
) -> ClosedLoopResult:
    """Run a controller on the rig while one drive fails.

    Until the loss is detected the other drive gives only its own part of the torque, and the load is disturbed. From
    then on the torque of the controller is allocated to the other drive alone, in both directions and within its limit.
    The motion continues; its flank loses contact whenever the torque reverses, and the backlash has an effect. Motor
    encoders are not used any more: their angle is wrong by the backlash.

    Args:
        controller: a new one.
        rig: the machine.
        reference: (T,) reference of the load angle [rad].
        pushes: (T,) disturbance torque on the load [N m].
        drive: 1 or 2, the one that fails.
        time: of the failure [s].
        seed: of the encoder's noise.
        detection: delay until the loss is detected [s].
        after_sample: called after each sample.
    """
    dt, ahead = controller.sample_time, controller.horizon
    left = Allocator(rig.gears, min_torque=controller.min_torque, max_torque=controller.max_torque, lost=(drive,))
    wanted = np.append(reference, np.full(ahead, reference[-1]))
    rng = np.random.default_rng(seed)
    broken_from, known_from = round(time / dt), round((time + detection) / dt)
    alive = np.arange(1, 3) != drive
    first = least_effort(controller.bounds, 0.0)
    state = rig.rest(float(reference[0]), first if broken_from > 0 else np.zeros(2))
    rows: dict[str, list[float]] = {name: [] for name in ("angle", "velocity", "measured", "unknown", "margin")}
    torques, flanks, status = [], [], []
    for k, push in enumerate(pushes):
        measured = rig.measure(state, rng)
        shown = None
        if controller.motor_resolution is not None:
            shown = rig.motor_angles(state) if k < known_from else np.full(2, np.nan)
        control = controller.step(measured, wanted[k : k + ahead + 1], shown)
        applied, stated, margin = control.torques, control.status, control.margin
        if k >= known_from:
            alone = left.allocate(float(rig.gears.output_torque(applied)))
            applied, stated, margin = alone.torques, alone.status, alone.margin
        elif k >= broken_from:
            applied = applied * alive
        for name, value in zip(rows, (state.angle, state.velocity, measured, control.disturbance, margin), strict=True):
            rows[name].append(value)
        state = rig.advance(state, applied, dt, float(push))
        torques.append(applied)
        flanks.append(state.minimum_contact_torques)
        status.append(stated)
        if after_sample is not None:
            after_sample()
    columns = {name: np.array(values) for name, values in rows.items()}
    return ClosedLoopResult(
        time=np.arange(len(pushes), dtype=np.float64) * dt,
        reference=reference.copy(),
        angle=columns["angle"],
        measured_angle=columns["measured"],
        velocity=columns["velocity"],
        torques=np.array(torques),
        disturbance=columns["unknown"],
        margin=columns["margin"],
        contact_torques=np.array(flanks),
        status=tuple(status),
        axis=controller.model.axis,
    )
