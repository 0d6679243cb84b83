"""Scenarios of `antidrive simulate`: one file is one scenario, and its key `kind` selects the type."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from antidrive.remaining_time import Parts, Tell
from antidrive.scenario import parse_scenario, scenario_text
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.servo import ServoModel

if TYPE_CHECKING:
    from antidrive.closed_loop_run import ClosedLoopRun
    from antidrive.experiments.outcome import Outcome

Result: TypeAlias = "ClosedLoopRun | Outcome"


@dataclass(frozen=True, kw_only=True)
class Design:
    """Model, drives and controller options of a loop.

    Attributes:
        model: of the controller, and of the test bench; None for that of the rig.
        train: drives; None for those of the paper.
        options: attributes of the controller.
    """

    model: ServoModel | None = None
    train: DriveTrain | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ScenarioFile:
    """A scenario that has been read and can be run.

    Attributes:
        name: of the scenario.
        play: function of the design, the seed, and the progress callback.
    """

    name: str
    play: Callable[[Design, int, Tell | None], Result]

    def run(self, design: Design | None, seed: int, tell: Tell | None = None) -> Result:
        """Run it; without a design, with that of the rig."""
        return self.play(design or Design(), seed, tell)


def read_scenario_file(name: str) -> ScenarioFile:
    """A scenario by its name, or from a TOML file: a closed loop, or an experiment if the file has a `kind`.

    Raises:
        BadParameter: there is no such name or file, or the file has an unknown key or an unusable value.
    """
    text = scenario_text(name)
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError):
        content = {}  # the parser of closed loops reports the error
    if "kind" in content:
        return _experiment(name, content)
    from antidrive.simulation import REPETITIONS, run_scenario

    scenario = parse_scenario(name, text)

    def play(design: Design, seed: int, tell: Tell | None) -> Result:
        return run_scenario(
            scenario,
            model=design.model,
            train=design.train,
            options=design.options,
            seed=seed,
            repetitions=REPETITIONS,
            tell=tell,
        )

    return ScenarioFile(name=scenario.name, play=play)


def _experiment(name: str, content: Mapping[str, Any]) -> ScenarioFile:
    from antidrive.experiments.kinds import KINDS
    from antidrive.experiments.scatter import with_scatter
    from antidrive.experiments.settings import read_settings

    kind = KINDS.get(content["kind"]) if isinstance(content["kind"], str) else None
    if kind is None:
        raise BadParameter(f"{name}: kind is {content['kind']!r}; it must be one of {', '.join(KINDS)}.")
    settings = read_settings(kind.settings, name, content)

    def play(design: Design, seed: int, tell: Tell | None) -> Result:
        if design != Design():
            raise BadParameter(f"{name}: an experiment takes no --model, and no other drives or controller.")
        if kind.long:
            return kind.run(settings, seed, tell)
        done, runs = Parts(1 + kind.again, tell).done, []
        for other in range(1 + kind.again):
            runs.append(kind.run(settings, seed + other))
            done()
        return with_scatter(runs)

    return ScenarioFile(name=name, play=play)
