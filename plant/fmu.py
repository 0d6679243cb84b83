"""A sampled machine as an FMU: C code and its description in one file for Simulink and Modelica tools.

FMI 2.0, co-simulation (Modelica Association, fmi-standard.org). `plant/fmu.c` has the functions that a tool calls.
"""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as xml

from plant.errors import BadParameter
from plant.machine_code import compiler

_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fPIC", "-shared")
_HERE = {"linux": "linux64", "darwin": "darwin64", "win32": "win64"}
_ENDING = {"linux64": "so", "darwin64": "dylib", "win64": "dll"}
_TARGET = {"linux64": "x86_64-linux-gnu.2.17", "darwin64": "x86_64-macos", "win64": "x86_64-windows-gnu"}


@dataclass(frozen=True, kw_only=True)
class Variable:
    """A variable of a machine, as seen by a tool.

    Attributes:
        name: hierarchical, with dots.
        unit: such as "N m"; empty if there is none.
        meaning: in words.
        causality: "input", "output", or "parameter", which may be set before the start.
        start: value of an input or a parameter before it is set.
        lower, upper: bounds of a parameter.
        whole: whether it is a whole number.
    """

    name: str
    unit: str
    meaning: str
    causality: Literal["input", "output", "parameter"]
    start: float = 0.0
    lower: float = -float("inf")
    upper: float = float("inf")
    whole: bool = False


@dataclass(frozen=True, kw_only=True)
class Fmu:
    """A machine that can be written as an FMU.

    Attributes:
        name: of the file and its library; a C identifier.
        description: in a sentence.
        sample_time: between two samples of the machine [s]; a tool may take other steps.
        variables: in the order of their values in the machine.
        machine: C99 code of `struct machine` and its functions, see `plant/fmu.c`.
    """

    name: str
    description: str
    sample_time: float
    variables: tuple[Variable, ...]
    machine: str

    @cached_property
    def guid(self) -> str:
        """Identifier shared by library and description: equal for equal content."""
        content = repr((self.name, self.sample_time, self.variables, self.machine))
        return f"{{{uuid.UUID(bytes=hashlib.sha256(content.encode()).digest()[:16])}}}"

    @property
    def source(self) -> str:
        """The library's code, for any C99 compiler."""
        start = ", ".join(repr(float(variable.start)) for variable in self.variables)
        limits = "".join(
            f'  {{{place}, "{variable.name}", {_limit(variable.lower)}, {_limit(variable.upper)}}},\n'
            for place, variable in enumerate(self.variables)
            if variable.causality == "parameter"
        )
        return (
            f'#include <math.h>\n\n#define GUID "{self.guid}"\n#define SAMPLE_TIME {self.sample_time!r}\n'
            f"enum {{ VARIABLES = {len(self.variables)} }};\nstatic const double first[VARIABLES] = {{{start}}};\n"
            "static const struct { int place; const char *name; double lower, upper; } limits[] = {\n"
            f"{limits}  {{-1, 0, 0, 0}}\n}};\n\n"
            f"{self.machine}\n{(files('plant') / 'fmu.c').read_text(encoding='utf-8')}"
        )

    @property
    def model_description(self) -> bytes:
        """Content of modelDescription.xml."""
        root = xml.Element(
            "fmiModelDescription",
            fmiVersion="2.0",
            modelName=self.name,
            guid=self.guid,
            description=self.description,
            generationTool=f"antidrive {version('antidrive')}",
            variableNamingConvention="structured",
        )
        can = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate")
        slave = xml.SubElement(root, "CoSimulation", {"modelIdentifier": self.name} | dict.fromkeys(can, "true"))
        xml.SubElement(xml.SubElement(slave, "SourceFiles"), "File", name=f"{self.name}.c")
        units = xml.SubElement(root, "UnitDefinitions")
        for unit in dict.fromkeys(variable.unit for variable in self.variables if variable.unit):
            xml.SubElement(units, "Unit", name=unit)
        xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="10", stepSize=repr(self.sample_time))
        variables = xml.SubElement(root, "ModelVariables")
        for reference, variable in enumerate(self.variables):
            _describe(variables, reference, variable)
        structure = xml.SubElement(root, "ModelStructure")
        for kind in ("Outputs", "InitialUnknowns"):
            listed = xml.SubElement(structure, kind)
            for place, variable in enumerate(self.variables, start=1):
                if variable.causality == "output":
                    unknown = xml.SubElement(listed, "Unknown", index=str(place))
                    if kind == "Outputs":  # a sample takes time, so no output depends directly on an input
                        unknown.set("dependencies", "")
        xml.indent(root)
        text: str = xml.tostring(root, encoding="unicode")
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()

    def write(self, path: Path, *, after: Callable[[], None] | None = None) -> None:
        """Write the FMU, with a library for this platform and its source for others.

        With the package `ziglang` there are libraries for Linux, macOS and Windows (x86-64); the first time takes
        minutes.

        Args:
            path: file to write.
            after: called after each of the `compilers` has made its library.

        Raises:
            BadParameter: there is no C compiler, or it fails.
        """
        content = {"modelDescription.xml": self.model_description, f"sources/{self.name}.c": self.source.encode()}
        for platform, line in self.compilers().items():
            content[f"binaries/{platform}/{self.name}.{_ENDING[platform]}"] = self._library(line)
            if after is not None:
                after()
        with zipfile.ZipFile(path, "w") as made:
            for name, part in content.items():
                made.writestr(zipfile.ZipInfo(name), part, zipfile.ZIP_DEFLATED)  # without a date: equal each time

    def compilers(self) -> dict[str, tuple[str, ...]]:
        """The compile command of each library, by platform.

        Raises:
            BadParameter: there is no C compiler.
        """
        command, here = compiler(), _HERE.get(sys.platform, "linux64")
        if command is None:
            raise BadParameter("An FMU needs a C compiler: name one in CC, or `pip install 'antidrive[fast]'`.")
        commands = {here: command}
        if find_spec("ziglang"):
            zig = (sys.executable, "-m", "ziglang", "cc", "-target")
            commands = {platform: (*zig, target) for platform, target in _TARGET.items()} | commands
        return commands

    def _library(self, command: tuple[str, ...]) -> bytes:
        with tempfile.TemporaryDirectory(prefix="antidrive-") as folder:
            (Path(folder) / f"{self.name}.c").write_text(self.source, encoding="utf-8")
            line = [*command, *_FLAGS, f"{self.name}.c", "-o", "library", "-lm"]
            done = subprocess.run(line, cwd=folder, capture_output=True, text=True)
            if done.returncode != 0:
                raise BadParameter(f"{command[0]} cannot compile the FMU: {done.stderr.strip() or done.returncode}")
            return (Path(folder) / "library").read_bytes()


def _limit(value: float) -> str:
    """A bound in C syntax."""
    return f"{'-' if value < 0 else ''}INFINITY" if math.isinf(value) else repr(float(value))


def _describe(variables: xml.Element, reference: int, variable: Variable) -> None:
    """Add the XML element of one variable."""
    entry = xml.SubElement(
        variables,
        "ScalarVariable",
        name=variable.name,
        valueReference=str(reference),
        description=variable.meaning,
        causality=variable.causality,
    )
    changes = {"input": "discrete" if variable.whole else "continuous", "output": "discrete", "parameter": "fixed"}
    entry.set("variability", changes[variable.causality])
    attributes = {} if variable.causality == "output" else {"start": repr(float(variable.start))}
    attributes |= {"unit": variable.unit} if variable.unit else {}
    attributes |= {"min": repr(float(variable.lower))} if variable.lower > -float("inf") else {}
    attributes |= {"max": repr(float(variable.upper))} if variable.upper < float("inf") else {}
    xml.SubElement(entry, "Integer" if variable.whole else "Real", attributes)
