"""An FMU in the tests, stepped by FMPy as a simulation tool would."""

from __future__ import annotations

from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from plant import Fmu


class Slave:
    """One instance, from its own file on, with its variables by name."""

    def __init__(self, fmu: Fmu, folder: Path, **parameters: float) -> None:
        """Write, check, load and start it."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{fmu.name}.fmu"
        fmu.write(path)
        assert validate_fmu(str(path)) == []
        self.description = fmpy.read_model_description(str(path))
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.messages: list[str] = []
        unpacked = fmpy.extract(str(path), unzipdir=str(folder / fmu.name))
        self.slave = FMU2Slave(
            guid=self.description.guid,
            unzipDirectory=unpacked,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="tested",
        )
        self.slave.instantiate()
        self.dt = fmu.sample_time
        self.begin(0.0, **parameters)

    def begin(self, now: float, **parameters: float) -> None:
        """Start at a time [s] with these parameters."""
        self.set(**parameters)
        self.slave.setupExperiment(startTime=now)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        self.samples, self.start = 0, now

    def set(self, **values: float) -> None:
        """Give inputs or parameters their values; "input_delay.time" is input_delay__time."""
        for name, value in values.items():
            self.slave.setReal([self.variables[name.replace("__", ".")].valueReference], [value])

    def get(self, *names: str) -> list[float]:
        """Values of variables."""
        found = []
        for name in names:
            variable = self.variables[name]
            get = self.slave.getInteger if variable.type == "Integer" else self.slave.getReal
            found += get([variable.valueReference])
        return found

    def sample(self, **inputs: float) -> None:
        """A step of one sample, with these inputs."""
        self.set(**inputs)
        self.step(self.start + self.samples * self.dt, self.dt)
        self.samples += 1

    def step(self, now: float, length: float) -> None:
        """A step of any length [s]."""
        self.slave.doStep(currentCommunicationPoint=now, communicationStepSize=length)

    def close(self) -> None:
        """Let go of the library."""
        self.slave.terminate()
        self.slave.freeInstance()
