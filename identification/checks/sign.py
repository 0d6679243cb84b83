"""Test whether the command drives the motion or has the wrong sign, also for each of two torques.

A column has one sign, so all runs of a log are tested together. In a single run with a constant command the motor
current may only react to cogging, which looks like a wrong sign.

Torque is inertia times acceleration plus terms of angle and speed. So the residual of the torque after regression on
these terms is proportional to that of the acceleration, and the slope is the inertia. A second statistic must not
contradict: the work of the torque on the load. The first one is unreliable for a single sine, because acceleration is
then proportional to the angle; the second one is unreliable in a loop that resists an external force, because the load
does work there.

A torque that drives the load explains most of the acceleration that these terms leave. One that explains little of it
may only react to the motion, as that of a controller that chatters with the noise of its encoder, some samples late.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from identification.checks.filtered_motion import DOUBTFUL, SURE, Products, View, over_runs, undisputed, views
from identification.log_columns import CURRENTS_OF_TWO, SINGLE_COMMANDS, TORQUES_OF_TWO
from identification.recording import Array, Finding, Recording

Given = TypeVar("Given")

_WORKS = 2.0  # Student's t of the work: one log in 30 by chance
_MOST = 0.5  # of the acceleration beyond other terms, explained by a command that drives the load
_ONE_WAY = 0.9  # work over absolute work of a command that drives the load, or brakes it, nearly always


@dataclass(frozen=True, kw_only=True)
class Witnesses:
    """Student's t of inertia and of work; share of the acceleration beyond other terms that the command explains."""

    inertia: float = 0.0
    work: float = 0.0
    share: float = 0.0

    @property
    def against(self) -> bool:
        """Whether the command drives the load and significantly has the wrong sign."""
        return self.inertia < -SURE and self.work < _WORKS and self.share > _MOST


def witnesses(commands: Sequence[Array], runs: Sequence[Sequence[View]]) -> Witnesses:
    """Both statistics of the command (T,) of each run, and the largest share behind any of the filters."""
    by_filter = _by_filter(commands, runs)
    statistics = [over_runs(view.inertia(command) for view, command in seen) for seen in by_filter]
    clearest = by_filter[int(np.argmax(np.abs(statistics)))]
    return Witnesses(
        inertia=undisputed(statistics),
        work=over_runs(view.work(command) for view, command in clearest),
        share=max(_share(np.sum([view.driven(command) for view, command in seen], axis=0)) for seen in by_filter),
    )


def _share(sums: Array) -> float:
    """Share of the acceleration that a command explains, from the sums of `View.driven`."""
    product, acceleration, command = sums
    return float(product**2 / max(acceleration * command, 1e-300))


def _by_filter(of_runs: Sequence[Given], runs: Sequence[Sequence[View]]) -> list[list[tuple[View, Given]]]:
    """For each filter, the views of all runs that are long enough for it, with what is given of each run."""
    seen = [(view, given) for views, given in zip(runs, of_runs, strict=True) for view in views]
    return [[each for each in seen if each[0].sigma == sigma] for sigma in sorted({view.sigma for view, _ in seen})]


def opposed(pairs: Sequence[tuple[Array, Array]], runs: Sequence[Sequence[View]]) -> bool:
    """Whether the motion explains the difference of two torques (T,) significantly better than their sum."""
    statistics = []
    for seen in _by_filter(pairs, runs):
        found = list[Products]()
        for view, (first, second) in seen:
            of_sum, of_difference = view.unexplained(first + second), view.unexplained(first - second)
            found.append((of_sum - of_difference, of_sum + of_difference))
        statistics.append(over_runs(found))
    return undisputed(statistics) > SURE


def sign_of_the_command(recordings: Sequence[Recording]) -> Iterable[Finding]:
    """A command against the acceleration makes the log unusable; one that only brakes gives a warning."""
    driven = [each for each in recordings if each.response == "angle" and not each.servo_gain.any()]
    seen = [(part, found) for part, found in map(views, driven) if found]
    if not seen:
        return
    parts, runs = [part for part, _ in seen], [found for _, found in seen]
    first = parts[0]
    where = first.label if len(parts) == 1 else f"the {len(parts)} runs together"
    command, output = first.name("command"), first.name("output")
    pairs = _pairs(parts)
    turned = _turned(parts, pairs, runs)
    if turned:
        text = (
            f"{where}: '{output}' accelerates against '{command}', as if the inertia were below zero, so one "
            f"of them has the wrong sign: {_options(turned)} turns it"
        )
        if len(turned) == 1 and pairs:
            one, two = map(first.name, _columns_of_two(first))
            text = (
                f"{where}: '{output}' moves with the difference of '{one}' and '{two}' and not with "
                f"their sum, so one of them has the wrong sign: {_options(turned)} turns it"
            )
        yield Finding(kind="sign of the command", repaired=False, text=text, unusable=True)
    elif _brakes([part.command for part in parts], runs):
        columns = _columns_of_two(first) if pairs else (_column(first),)
        text = (
            f"{where}: '{command}' opposes the motion almost all the time. Unless something else drives the "
            f"load, its sign is reversed: {_options(columns)} turns it"
        )
        yield Finding(kind="brakes", repaired=False, text=text)


def _turned(
    parts: Sequence[Recording], pairs: Sequence[tuple[Array, Array]], runs: Sequence[Sequence[View]]
) -> tuple[str, ...]:
    """Columns that need the other sign for the command to drive the motion; none if it does or if this is uncertain."""
    commands = [part.command for part in parts]
    if not pairs:
        return (_column(parts[0]),) if _against(commands, runs) else ()
    if opposed(pairs, runs):
        found = witnesses([first - second for first, second in pairs], runs)
        drives = found.inertia if abs(found.inertia) > SURE else found.work
        one, two = _columns_of_two(parts[0])
        return (two,) if drives > 0 else (one,)
    return _columns_of_two(parts[0]) if _against(commands, runs) else ()


def _options(columns: Sequence[str]) -> str:
    return " ".join(f"--scale {column}=-1" for column in columns)


def _column(recording: Recording) -> str:
    """The column for the option --scale."""
    known = [name for name in SINGLE_COMMANDS if name in recording.names]
    return known[0] if known else "force" if recording.axis == "linear" else "torque"


def _against(commands: Sequence[Array], runs: Sequence[Sequence[View]]) -> bool:
    """Whether the commands have the wrong sign; none that drives the load nearly always, as it speeds up with them."""
    return witnesses(commands, runs).against and _work_done(commands, runs) < _ONE_WAY


def _brakes(commands: Sequence[Array], runs: Sequence[Sequence[View]]) -> bool:
    """Whether the commands do negative work nearly always, so that the load drives the motor."""
    work = over_runs(views[0].work(command) for views, command in zip(runs, commands, strict=True))
    return _work_done(commands, runs) < -_ONE_WAY and work < -DOUBTFUL


def _work_done(commands: Sequence[Array], runs: Sequence[Sequence[View]]) -> float:
    """Work of the commands on the load over the absolute work: 1 if they always drive it, -1 if they brake it."""
    power = np.concatenate([views[0].power(command) for views, command in zip(runs, commands, strict=True)])
    return float(power.sum()) / max(float(np.abs(power).sum()), 1e-300)


def _columns_of_two(recording: Recording) -> tuple[str, str]:
    """The columns of two motors' currents, if they are what was logged, else of their torques."""
    return CURRENTS_OF_TWO if recording.others.keys() >= set(CURRENTS_OF_TWO) else TORQUES_OF_TWO


def _pairs(parts: Sequence[Recording]) -> list[tuple[Array, Array]]:
    """The two torques of each run; empty unless all runs have two."""
    pairs = [pair for pair in map(pinion_torques, parts) if pair is not None]
    return pairs if len(pairs) == len(parts) else []


def pinion_torques(recording: Recording) -> tuple[Array, Array] | None:
    """The part (T,) of each of two pinions in the command, if the command is their sum by the gears (eq. 2)."""
    columns = _columns_of_two(recording)
    if not recording.others.keys() >= set(columns):
        return None
    pinions = np.column_stack([recording.others[column] for column in columns])
    size = np.abs(pinions).max(axis=0)
    if not np.all(size > 0):
        return None
    ratio, *_ = np.linalg.lstsq(pinions / size, recording.command, rcond=1e-9)
    parts = pinions / size * ratio
    left = recording.command - parts.sum(axis=1)
    return (parts[:, 0], parts[:, 1]) if left @ left < 1e-12 * float(recording.command @ recording.command) else None
