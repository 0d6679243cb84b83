"""The fit's 95 % intervals hold the truth about 95 times in 100: a small edition of benchmarks/fit_coverage.py."""

from __future__ import annotations

import numpy as np
from machine import Machine, excitation, record

from identification.fit import fit

NAMES = ("inertia", "gravity", "viscous_friction", "dead_zone.half_width")
MACHINES = 12


def test_intervals_cover_the_truth_as_often_as_stated() -> None:
    rng = np.random.default_rng(7)
    truth = np.array([2.0, 0.5, 0.8, 0.5]) * 1.6 ** rng.uniform(-1.0, 1.0, (MACHINES, 4))
    inertia, gravity, friction, gap = truth.T
    machines = Machine(
        inertia=inertia, gravity=gravity, viscous_friction=friction, effects={"dead_zone": {"half_width": gap}}
    )
    commands = np.column_stack([excitation(500 + b, duration=16.0) for b in range(MACHINES)])
    lines = [[fit(log)[name] for name in NAMES] for log in record(machines, commands, seed=7).logs()]
    values = np.array([[p.value for p in row] for row in lines], dtype=float)
    errors = np.array([[p.std for p in row] for row in lines], dtype=float)

    # Of 12 intervals at 95 %, fewer than 9 hold the truth twice in 1,000 times.
    inside = (np.abs(values - truth) < 1.96 * errors).sum(axis=0)
    assert inside.min() >= 9, dict(zip(NAMES, inside, strict=True))
    # And they are not too wide: the spread of 12 standard normal numbers is below 0.3 once in 10,000 times.
    assert (np.std((values - truth) / errors, axis=0) > 0.3).all()
    relative = np.abs(values / truth - 1.0)
    assert np.median(relative, axis=0).max() < 0.01
    assert relative.max() < 0.05
