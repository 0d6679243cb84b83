"""The controller with the nominal model on 1,000 machines whose parameters differ by up to 20 %.

    python benchmarks/monte_carlo.py [runs] [processes]

The machine is that of the preload formulas: load 0.4 kg m^2, rotors of 0.15 kg m^2 each at the load side, a hanging
load that is moved up and back. A flank with planned torque T_min loses at most

    its loss on the nominal machine            motor friction f, corrections of the torque, vibration of the gears
    + spread (n^2 J_m a + f)                   unknown part of rotor inertia and friction

at the greatest acceleration a. That is the acceleration of the reference; near the limit, where the load lags and then
catches up, it is that of the total torque plus gravity. Writes benchmarks/results/monte_carlo.txt.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from allocation import Allocator, capability_map
from mpc import Controller, MonteCarlo, closed_loop, monte_carlo
from plant import GearTrain, Rig, ServoModel

GEARS = GearTrain.paper()
ROTOR = 0.15  # at the load side [kg m^2]
MOTOR = ROTOR / GEARS.ratio**2
RIG = Rig(gears=GEARS, inertia=0.4, gravity=12.0, viscous_friction=0.2, coulomb_friction=0.2, rotor_inertia=MOTOR)
MODEL = ServoModel(inertia=RIG.total_inertia, gravity=12.0, viscous_friction=0.2)
MAX_TORQUE = 2.5
SPREAD, DURATION, DT = 0.2, 2.0, 0.005
GOVERNED = 0.85  # share from which the governed reference lags behind and then catches up with full torque
MESH = float(GEARS.mesh_ratios[0])


def swing(acceleration: float) -> NDArray[np.float64]:
    """From the hanging position to the horizontal and back, with that greatest acceleration [rad/s^2]."""
    time = np.arange(round(DURATION / DT) + 50) * DT
    amplitude = np.pi / 4
    return -np.pi / 2 + amplitude * (1 - np.cos(np.sqrt(acceleration / amplitude) * np.maximum(time - 0.1, 0.0)))


def edge(least: float) -> float:
    """Greatest acceleration of the hanging load without loss of contact [rad/s^2]."""
    allocator = Allocator(GEARS, min_torque=least, max_torque=MAX_TORQUE, rotor_inertia=MOTOR)
    found = capability_map(
        allocator, inertia=RIG.total_inertia, acceleration=np.linspace(-40, 40, 801), load_torque=[0.0]
    )
    return float(found.edge[0, 1])


def catching_up(floor: float) -> float:
    """Greatest acceleration of any machine, that of heavy rotors: downward, with full torque [rad/s^2]."""
    most, least = 1 + SPREAD, 1 - SPREAD
    return (MESH * (MAX_TORQUE - floor) + most * RIG.gravity) / (least * RIG.inertia + most * 2 * ROTOR)


def row(share: float, least: float, rotors: bool, runs: int, executor: Executor | None) -> list[str]:
    """Lines for many machines moved with a share of the nominal machine's greatest acceleration at T_min [N m]."""
    floor = least / MESH
    acceleration = share * edge(floor)
    design = partial(
        Controller, MODEL, GEARS, min_torque=floor, max_torque=MAX_TORQUE, rotor_inertia=MOTOR if rotors else 0.0
    )
    nominal = closed_loop(design(), RIG, swing(acceleration), DURATION, 0)
    begin = time.perf_counter()
    found = monte_carlo(
        design, RIG, swing(acceleration), DURATION, runs=runs, spread=SPREAD, executor=executor, progress=tell
    )
    taken = time.perf_counter() - begin
    own = least - nominal.minimum_contact_torque
    fastest = acceleration if share < GOVERNED else catching_up(floor)
    predicted = SPREAD * (ROTOR * fastest + float(GEARS.ratio) * RIG.motor_coulomb) + own
    planned = "flank torque" if rotors else "motor torque"
    rms = np.percentile(found.tracking_rms, [50, 99]) * 1e3
    worst, foreseen = least - found.minimum_contact_torque.min(), f"{predicted:8.2f}" if rotors else f"{'-':>8s}"
    lost, degraded = int(found.contact_lost.sum()), int(found.degraded.sum())
    line = (
        f"{share:5.2f} {acceleration:5.1f} {least:6.2f}  {planned}  {lost:6d} of {runs:5d} {least - worst:7.2f} "
        f"{own:6.2f} {worst:6.2f}  {foreseen} {rms[0]:8.2f} {rms[1]:8.2f} {degraded:6d}"
    )
    return [line, f"      {why(found)}; {taken:.0f} s"]


def why(found: MonteCarlo) -> str:
    """Parameters with the highest rank correlation with the minimum flank torque."""
    ranks = np.argsort(np.argsort(found.factors, axis=0), axis=0)
    own = np.argsort(np.argsort(found.minimum_contact_torque))
    with_it = {name: np.corrcoef(r, own)[0, 1] for name, r in zip(found.names, ranks.T, strict=True)}
    first = sorted(with_it.items(), key=lambda pair: -abs(pair[1]))[:3]
    return "goes with " + ", ".join(f"{name.replace('_', ' ')} {value:+.2f}" for name, value in first)


def tell(line: str) -> None:
    print(f"\r{line:79s}", end="", file=sys.stderr, flush=True)


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    processes = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    lines = [
        f"{runs} machines each, {SPREAD:.0%} around the nominal one; {DURATION:g} s simulated; seed 0",
        "share of the acceleration a [rad/s^2] at the edge of the nominal machine's capability map",
        "T_min: planned to stay on each flank [N m], seen from the load; least: what stayed on any machine",
        "taken away from T_min: on the nominal machine, at worst, and as foreseen; tracking rms [mrad]",
        "",
        "share     a  T_min  planned with    contact lost   least   nom.  worst  foreseen   median     99 %  degr.",
    ]
    print("\n".join(lines))
    with ExitStack() as stack:
        executor = None
        if processes > 1:
            pool = ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn"))
            executor = stack.enter_context(pool)
        for share, least, rotors in (
            (0.75, 0.4, True),
            (0.75, 0.8, True),
            (0.75, 0.8, False),
            (1.0, 0.8, True),
            (1.0, 1.6, True),
        ):
            lines += row(share, least, rotors, runs, executor)
            tell("")
            print("\r" + "\n".join(lines[-2:]), flush=True)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "monte_carlo.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
