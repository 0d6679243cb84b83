"""Draw docs/pictures/demo.png: what the report of the demo shows.

antidrive demo && python docs/picture.py antidrive-out
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from diagnosis.residual_torque import residual_torque
from identification import Log, fit
from identification.simulation import free_simulation
from plant.model_file import read_model

GREY, ORANGE, BLUE = "#8a929b", "#e07b27", "#2f7fd1"


def main() -> None:
    """Draw it from the files that the demo wrote."""
    folder = Path(sys.argv[1])
    base, extended = (read_model(folder / name).model for name in ("base-model.json", "model.json"))
    validation = Log.read(folder / "validation.csv")
    (run,) = validation.runs
    figure, (angle, error, torque) = plt.subplots(1, 3, figsize=(13, 3.4), layout="constrained")
    angle.plot(run.time, run.output, color=GREY, lw=4, label="measured")
    for model, colour, name in ((base, ORANGE, "base model"), (extended, BLUE, "with the effects found")):
        (simulated,) = free_simulation(validation, model)
        angle.plot(run.time, simulated, color=colour, lw=1.2, label=name)
        error.semilogy(run.time, np.maximum(np.abs(run.output - simulated), 1e-6), color=colour, lw=0.8, label=name)
    angle.set(xlabel="time [s]", ylabel="angle [rad]", title="Validation data, simulated from the torque alone")
    angle.legend(loc="best")
    error.set(xlabel="time [s]", ylabel="absolute error [rad]", title="Error of the simulation")
    missing = residual_torque(fit(Log.read(folder / "log.csv"), base))
    over = next(curve for curve in missing.curves if curve.variable == "velocity")
    torque.fill_between(over.centre, over.mean - over.band, over.mean + over.band, color=ORANGE, alpha=0.35, lw=0)
    torque.plot(over.centre, over.mean, color=ORANGE)
    torque.set(xlabel="velocity [rad/s]", ylabel="torque [N m]", title="Residual torque of the base model")
    for axes in (angle, error, torque):
        axes.grid(alpha=0.3)
    figure.savefig(Path(__file__).parent / "pictures" / "demo.png", dpi=80)


if __name__ == "__main__":
    main()
