"""A command without its sign: a duty beside a pin for the direction, of which only the size was logged."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.checks.filtered_motion import views
from identification.recording import Finding, Recording

_FAST, _REST = 0.3, 0.02  # of the 95th percentile of the speed: in motion, at rest
_LEAST = 20  # samples of each kind
_HALF = 0.5  # of the command in motion that the command at rest must stay below


def size_of_the_command(recording: Recording) -> Iterable[Finding]:
    """Warn of a command that is never negative and pushes in both directions.

    A lifted load moves both ways under one sign, too, but its command is lower on the way down than at rest.
    """
    if recording.servo_gain.any() or recording.command.min() < 0 or not recording.command.max() > 0:
        return
    part, seen = views(recording)
    if not seen:
        return
    view = seen[0]
    command, usual = view.behind(part.command), float(np.percentile(np.abs(view.speed), 95))
    at_rest = command[np.abs(view.speed) < _REST * usual]
    both_ways = (command[view.speed > _FAST * usual], command[view.speed < -_FAST * usual])
    if min(map(len, (at_rest, *both_ways))) < _LEAST:
        return
    if np.percentile(at_rest, 75) < _HALF * min(map(np.median, both_ways)):
        text = (
            f"{recording.label}: '{recording.name('command')}' is never below zero, but '{recording.name('output')}' "
            "moves both ways when it is large and rests when it is small, as if only its size was logged: give it the "
            "sign of the drive's direction, or name another command, for example --map setpoint=NAME"
        )
        yield Finding(kind="size of the command", repaired=False, text=text)
