"""C code for a target in the tests: recordings from the Python controller, and a compiler to play them through."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpc import Controller
from mpc.export import TargetCode
from mpc.status import sentence
from plant import GearTrain, Rig, ServoModel
from plant.effects import ActuatorLag, Compliance, CoulombFriction, InputDelay

Array = NDArray[np.float64]

PAPER = GearTrain.paper()
UNEQUAL = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
RIGID = ServoModel(inertia=2.0, gravity=0.45, viscous_friction=1.5)
MODELS = {
    "rigid": RIGID,
    "late": RIGID.with_effect(InputDelay(time=0.013)).with_effect(CoulombFriction(torque=0.2)),
    "lag": RIGID.with_effect(ActuatorLag(time_constant=0.01)),
    "compliance": RIGID.with_effect(Compliance(frequency=40.0, damping=0.1, motor_share=0.3)),
}
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off")


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What a controller was shown, a line of CSV a sample, and what it answered."""

    lines: str
    torques: Array
    statuses: tuple[str, ...]


def recorded(controller: Controller, *, ahead: bool, samples: int = 500) -> Recording:
    """A closed loop on the rig with steps and a sine to follow, and readings that are lost or jump."""
    rig, rng, dt = Rig.paper_like(), np.random.default_rng(0), controller.sample_time
    time = dt * np.arange(samples + controller.horizon + 1)
    reference = np.where(time < 1.2, 0.4 * (time > 0.2), 0.3 * np.sin(2.0 * time))
    state, rows, torques, statuses = rig.rest(0.0, (0.02, -0.02)), [], [], []
    for k in range(samples):
        shown = {0: np.nan, 60: np.nan, 90: 1.0, 400: np.inf}.get(k, rig.measure(state, rng))
        wanted = np.nan if k == 450 else reference[k : k + controller.horizon + 1] if ahead else reference[k]
        motors = None if controller.motor_resolution is None else rig.motor_angles(state)
        control = controller.step(shown, wanted, motors)
        rows.append([shown, *([] if motors is None else motors), *np.atleast_1d(wanted)])
        torques.append(control.torques)
        statuses.append(control.status)
        state = rig.advance(state, control.torques, dt)
    lines = "".join(",".join(repr(float(number)) for number in row) + "\n" for row in rows)
    return Recording(lines=lines, torques=np.array(torques), statuses=tuple(statuses))


def built(files: Mapping[str, str], folder: Path, *flags: str, main: str = "driver.c") -> Path:
    """The program of some files."""
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    (code,) = (name for name in files if name.endswith("controller.c"))
    line = ["gcc", *STRICT, *flags, code, *([main] if main else []), "-o", "program", "-lm"]
    result = subprocess.run(line, cwd=folder, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return folder / "program"


def played(program: Path, lines: str) -> tuple[Array, tuple[str, ...]]:
    """Torques (T, 2) and statuses in words that a driver answers."""
    result = subprocess.run([program], input=lines, capture_output=True, text=True, cwd=program.parent)
    assert (result.returncode, result.stderr) == (0, "")
    head, *rows = result.stdout.splitlines()
    assert head == "torque_1,torque_2,status"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    reasons = [sentence(int(code)) for code in table[:, 2]]
    return table[:, :2], tuple(f"degraded: {words}" if words else "optimal" for words in reasons)


class Loaded:
    """A controller for a target in this process.

    Attributes:
        memory: the struct, as numbers.
        status: of the last step.
    """

    def __init__(self, made: TargetCode, folder: Path) -> None:
        careful = ("-Wdouble-promotion",) if made.precision == "single" else ()
        program = built(made.files, folder, "-O2", "-shared", "-fPIC", *careful, main="")
        self._library = ctypes.CDLL(str(program))
        number = np.float32 if made.precision == "single" else np.float64
        real = ctypes.c_float if made.precision == "single" else ctypes.c_double
        self._library.antidrive_step.argtypes = (ctypes.c_void_p, real, real, ctypes.c_void_p)
        self._library.antidrive_step_ahead.argtypes = (ctypes.c_void_p, real, ctypes.c_void_p, ctypes.c_void_p)
        self._library.antidrive_elapsed.argtypes = (ctypes.c_void_p, real)
        self.status = 0
        self.memory, self._torques = np.zeros(made.memory // number().itemsize, number), np.zeros(2, number)
        self._library.antidrive_init(ctypes.c_void_p(self.memory.ctypes.data))

    def elapsed(self, seconds: float) -> None:
        """The time since the last step [s]."""
        self._library.antidrive_elapsed(self.memory.ctypes.data, seconds)

    def step(self, angle: float, reference: float | Array) -> Array:
        """The pinion torques (2,) of a sample [N m]; the reference is a number, or known (N + 1,) samples ahead."""
        torques = self._torques.ctypes.data
        if isinstance(reference, np.ndarray):
            ahead = reference.astype(self.memory.dtype)
            self.status = self._library.antidrive_step_ahead(self.memory.ctypes.data, angle, ahead.ctypes.data, torques)
        else:
            self.status = self._library.antidrive_step(self.memory.ctypes.data, angle, reference, torques)
        return self._torques.astype(np.float64)


def at_its_worst(made: TargetCode) -> dict[str, str]:
    """The same files, but every loop runs to its bound and no solution is ever accepted."""
    code = made.files["antidrive_controller.c"]
    for old, new in (
        ("for (k = 0; k < missed; ++k) miss(c);", "for (k = 0; k < HORIZON; ++k) miss(c);"),
        ("if (!(elapsed > 0 && isfinite(elapsed))) return;", "elapsed = dt;"),
        ("round < TRIES && (changes || warm)", "round < TRIES"),
        ("    if (!(left(c, &mean) > CLOSE)) break;", "    left(c, &mean);"),
        ("if (worst <= CERTIFIED && (settled || ROWS == 1)) return worst;", "(void)settled;"),
        ("c->plan[0] = worst <= CERTIFIED;", "c->plan[0] = 0;"),
        ("pass < PASSES && (!pass || most > CONVERGED * c->unit[0])", "pass < PASSES"),
    ):
        assert code.count(old) == 1, old
        code = code.replace(old, new)
    return {**made.files, "antidrive_controller.c": code}
