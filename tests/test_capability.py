"""The capability map against the formulas of the machine, the allocator and a linear program."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from allocation import Allocator, capability_map
from plant.errors import BadParameter
from plant.gears import GearTrain

PAPER = GearTrain.paper()
N, TEETH = 161 / 20, 20
ROTOR, LEAST, MOST = 1e-5, 0.02, 0.3
ALLOCATOR = Allocator(PAPER, min_torque=LEAST, max_torque=MOST, rotor_inertia=ROTOR)
J = 2.0
AXES = {"acceleration": np.linspace(-1.5, 1.5, 31), "load_torque": np.linspace(-3, 3, 25)}


def test_least_preload_is_the_known_formula() -> None:
    found = capability_map(ALLOCATOR, inertia=J, **AXES)
    rotors = ROTOR * (PAPER.pre_reduction * N) ** 2  # of one rotor, seen from the load
    total = J * AXES["acceleration"][:, None] + AXES["load_torque"]
    # what the meshes pass, each motor carrying its own rotor: the equal split
    passed = total - 2 * rotors * AXES["acceleration"][:, None]
    preload = found.least_preload * TEETH * N  # seen from the load
    by_flank, by_motor = np.abs(passed) / 2 + LEAST * N, np.abs(total) / 2 + LEAST * N
    inside = found.reachable
    assert 0.3 < np.mean(inside) < 0.9
    assert preload[inside] == pytest.approx(np.maximum(by_flank, by_motor)[inside])
    assert np.any((by_flank > by_motor + 1e-3) & inside)
    assert np.any((by_motor > by_flank + 1e-3) & inside)


def test_the_map_is_what_the_allocator_does() -> None:
    unequal = Allocator(
        GearTrain(pinion_teeth=(20, 31), output_teeth=161, stages=PAPER.stages),
        min_torque=LEAST,
        max_torque=MOST,
        rotor_inertia=ROTOR,
        motor_friction=1e-4,
        weights=(1.0, 3.0),
    )
    found = capability_map(unequal, inertia=J, **AXES)
    for i in range(0, 31, 5):
        for k in range(0, 25, 4):
            a, load = AXES["acceleration"][i], AXES["load_torque"][k]
            one = unequal.allocate(J * a + load, a)
            assert (one.status == "optimal") == found.reachable[i, k]
            if found.reachable[i, k]:
                assert found.least_preload[i, k] == pytest.approx(one.preload)
                assert found.copper_loss[i, k] == pytest.approx(one.copper_loss)
            else:
                assert np.isnan(found.least_preload[i, k])
                assert found.margin[i, k] < 0
            b, low = unequal.bounds.structure.pushing[0], unequal.bounds.lower(a)
            # greatest t: b x = tau, x - t >= low, x <= MOST
            best = linprog(
                [0, 0, -1],
                A_ub=[[-1, 0, 1], [0, -1, 1]],
                b_ub=-low,
                A_eq=[[*b, 0]],
                b_eq=[J * a + load],
                bounds=[(None, MOST), (None, MOST), (None, None)],
            )
            assert found.margin[i, k] == pytest.approx(-best.fun, abs=1e-9)


def test_preload_costs_about_half_of_the_peak_torque() -> None:
    found = capability_map(ALLOCATOR, inertia=J, acceleration=[0.0], load_torque=np.linspace(-5, 5, 2001))
    peak = found.load_torque[found.reachable[0]][-1]
    assert peak == pytest.approx(N * (MOST - LEAST), abs=5e-3)
    assert 0.4 < peak / (2 * N * MOST) < 0.5
    assert found.margin[0, 1000] == pytest.approx(MOST - LEAST)
    assert found.copper_loss[0, 1000] == pytest.approx(2 * LEAST**2)


def test_the_edge_is_where_the_allocator_gives_up() -> None:
    found = capability_map(ALLOCATOR, inertia=J, **AXES)
    for load, (least, greatest) in zip(found.load_torque, found.edge, strict=True):
        for a, outwards in ((least, -1e-3), (greatest, 1e-3)):
            if abs(a) < 1.5:
                assert ALLOCATOR.allocate(J * (a - outwards) + load, a - outwards).status == "optimal"
                assert ALLOCATOR.allocate(J * (a + outwards) + load, a + outwards).status != "optimal"
    far = capability_map(ALLOCATOR, inertia=J, acceleration=[-1.0, 0.0, 1.0], load_torque=[0.0, 9.0])
    assert np.all(np.isnan(far.edge[1]))
    assert far.edge[0] == pytest.approx([-1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inertia": 0.0}, "inertia"),
        ({"acceleration": [1.0, 0.0]}, "acceleration"),
        ({"load_torque": [np.nan]}, "load_torque"),
        ({"load_torque": 1.0}, "load_torque"),
        ({"allocator": ALLOCATOR.without(1)}, "two working drives"),
        ({"allocator": Allocator([[1, -1, 1], [1, 1, -2]], min_torque=0, max_torque=1)}, "two working drives"),
    ],
)
def test_refuses_what_has_no_map(change: dict[str, object], message: str) -> None:
    good = {"allocator": ALLOCATOR, "inertia": J, **AXES}
    with pytest.raises(BadParameter, match=message):
        capability_map(**{**good, **change})  # type: ignore[arg-type]
