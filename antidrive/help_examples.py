"""Examples of each command for its help; the tests parse them all."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("antidrive demo", "antidrive demo --seed 3 --out demo-3"),
    "identify": (
        "antidrive identify log.csv",
        "antidrive identify log.csv --map angle=qm --unit angle=deg --scale torque=35.15",
        "antidrive identify log.csv --fixed gravity --prior inertia=0.2:0.05",
        "antidrive identify scope.mf4 --json > fit.json",
    ),
    "diagnose": (
        "antidrive diagnose monday.csv tuesday.csv --holdout friday.csv",
        "antidrive diagnose log.parquet --base model.json --out friction",
        "antidrive diagnose log.csv --bounds inertia=0.1:0.3 --exclude backlash",
        "antidrive diagnose --dataset emps --data FOLDER",
    ),
    "inspect": (
        "antidrive inspect log.csv",
        "antidrive inspect drive.csv encoder.csv --ratio 8.05 && antidrive diagnose antidrive-out/log.toml",
    ),
    "predict": (
        "antidrive predict model.json log.csv --out prediction.csv",
        "antidrive predict model.json log.csv --window 2 --measured --out friday.parquet",
    ),
    "simulate": (
        "antidrive simulate tracking --model model.json",
        "antidrive simulate my-loop.toml --seed 1 --out run-1",
    ),
    "effects": ("antidrive effects", "antidrive effects cogging"),
    "allocate": ("antidrive allocate 0.5 -- -1.2", "antidrive allocate 2 --min-torque 0.05 --json"),
    "capability": ("antidrive capability --inertia 2 --rotor-inertia 0.002",),
    "export": (
        "antidrive export model.json --out target --single",
        "antidrive export model.json --name elbow --ratio 50,-50 --max-torque 2 --bandwidth 3",
        "antidrive export model.json --fmu --gears 18,18:144",
        "antidrive export model.json --feedforward --single",
        "antidrive export model.json --mujoco --out mujoco",
    ),
    "plan": (
        "antidrive plan --limits travel=-1:1,speed=5,acceleration=50 --out experiment.csv",
        "antidrive plan --limits torque=2 --rate 1000",
    ),
    "friction": (
        "antidrive friction staircase.csv",
        "antidrive friction sweep.csv --torque-constant 0.035 && antidrive table friction antidrive-out/model.json",
    ),
    "compare": (
        "antidrive compare monday/model.json friday.csv",
        "antidrive compare model.json friday.csv --candidates cogging,backlash --fixed inertia",
    ),
    "table": (
        "antidrive table friction model.json --points 64",
        "antidrive table cogging model.json --range 0:6.2832 --single",
        "antidrive table backlash model.json",
    ),
}


def examples_of(command: str) -> str:
    """Text below the options in a command's help."""
    return "\n\n".join(("Examples:", *(f"  {line}" for line in EXAMPLES[command])))
