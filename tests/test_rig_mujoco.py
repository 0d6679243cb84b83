"""The rig beside the same machine in MuJoCo: free motion, when the teeth meet, and what they then pass on.

MuJoCo's joint limits are the flanks: springs and dampers that only push. Its solver blends the law of a constraint with
that of free motion; at the least blend that it allows, one part in ten thousand, what is left is the law of the flank.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from plant.rig import Rig

mujoco = pytest.importorskip("mujoco")

Array = NDArray[np.float64]

STEP, SAMPLE, BLEND = 5e-6, 2.5e-4, 1e-4  # MuJoCo's step [s], the rig's sample [s], blend of a constraint
RIG = Rig.paper_like(
    motor_viscous=0.0, motor_coulomb=0.0, encoder_counts=0, encoder_noise=0.0, motor_encoder_counts=0, fine_step=STEP
)
ROTOR = RIG.rotor_inertia * RIG.gears.ratio**2
OFFSET = RIG.gravity / 9.81  # of a mass of one kilogram [m]
LOOSENESS = (1 / ROTOR + 1 / RIG.inertia) * (1 - BLEND)  # from a flank's torque to MuJoCo's acceleration
MODEL = f"""
<mujoco>
  <option timestep="{STEP}" gravity="0 0 -9.81" integrator="Euler" tolerance="1e-14"/>
  <worldbody><body>
    <joint type="hinge" axis="0 -1 0" damping="{RIG.viscous_friction}"/>
    <inertial pos="{OFFSET} 0 0" mass="1" diaginertia="{" ".join(3 * [str(RIG.inertia - OFFSET**2)])}"/>
    {
    2
    * f'''<body>
      <joint type="hinge" axis="0 -1 0" limited="true" range="{-RIG.backlash / 2} {RIG.backlash / 2}"
        solreflimit="{-RIG.flank_stiffness * LOOSENESS} {-RIG.flank_damping * LOOSENESS}"
        solimplimit="{BLEND} {BLEND} 1 0.5 1"/>
      <inertial pos="0 0 0" mass="1e-9" diaginertia="{ROTOR} {ROTOR} {ROTOR}"/>
    </body>'''
}
  </body></worldbody>
  <compiler angle="radian"/>
</mujoco>
"""


def commands() -> Array:
    """(T, 2) output torque of each drive [N m]: each crosses its gap back and forth, at times of its own."""
    t = np.arange(round(0.4 / SAMPLE)) * SAMPLE
    return np.column_stack((1.5 * np.sin(2 * np.pi * 5 * t + 2.0), 1.0 + 2.0 * np.sin(2 * np.pi * 7 * t)))


@cache
def both() -> tuple[dict[str, Array], dict[str, Array]]:
    """Load angle (T,), gap (T, 2) and flank torque (T, 2) of MuJoCo's machine and of the rig, at each sample."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    gap = np.array([-0.5, 0.5]) * RIG.backlash
    data.qpos[1:] = gap
    angle, gaps, flanks = [], [], []
    for torques in commands():
        data.qfrc_applied[:] = (torques.sum(), *torques)
        mujoco.mj_forward(model, data)
        angle.append(data.qpos[0])
        gaps.append(data.qpos[1:].copy())
        flanks.append(-data.qfrc_constraint[1:])
        for _ in range(round(SAMPLE / STEP)):
            mujoco.mj_step(model, data)
    theirs = {"angle": np.array(angle), "gap": np.array(gaps), "flank": np.array(flanks)}

    played = RIG.run(commands() / RIG.torque_map, SAMPLE, seed=0)
    rotors = played.motor_angles / (RIG.gears.pre_reduction * RIG.gears.angle_map)
    ours = {
        "angle": played.true_angle,
        "gap": rotors - played.true_angle[:, None],
        "flank": np.array([-1, 1]) * played.contact_torques,
    }
    return theirs, ours


def engagements(gap: Array) -> Array:
    """Times [s] at which a tooth meets a flank, on a straight line between samples."""
    outside = np.abs(gap) - RIG.backlash / 2
    k = np.flatnonzero((outside[:-1] < -1e-6) & (outside[1:] >= 0.0))
    return (k + outside[k] / (outside[k] - outside[k + 1])) * SAMPLE


def test_free_motion_is_the_same() -> None:
    theirs, ours = both()
    assert np.ptp(ours["angle"]) > 0.01
    assert ours["angle"] == pytest.approx(theirs["angle"], abs=2e-7)
    free = np.all(np.abs(ours["gap"]) < RIG.backlash / 2, axis=1)
    assert np.sum(free) > 20
    assert ours["gap"] == pytest.approx(theirs["gap"], abs=3e-6)  # of a play of 1.2e-3


def test_the_flanks_meet_at_the_same_times() -> None:
    theirs, ours = both()
    for drive in range(2):
        expected = engagements(theirs["gap"][:, drive])
        assert expected.size >= 3
        assert engagements(ours["gap"][:, drive]) == pytest.approx(expected, abs=2e-5)


def test_the_flanks_pass_the_same_torque() -> None:
    theirs, ours = both()
    greatest = np.max(np.abs(theirs["flank"]))
    assert greatest > 5.0
    assert np.max(np.abs(ours["flank"])) == pytest.approx(greatest, rel=1e-3)
    assert np.sqrt(np.mean((ours["flank"] - theirs["flank"]) ** 2)) < 1e-3 * greatest
