"""The output must respond after its command.

An output that responds before its command is impossible: the columns were recorded with an offset, or an effect that
the regression lacks looks so, where a command repeats itself. An output column that lags looks like a dead time of the
drive, and is left to the fit unless it is longer than any dead time of a drive.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from identification.checks.equation_error import Profile, profiles
from identification.recording import Finding, Recording

# A held command acts half a sample late, and some loggers write it at the end of its sample: less is not a fault.
_LEAST_SAMPLES, _LEAST_TIME = 1.5, 0.004
_LONG_SAMPLES, _LONG_TIME = 10.0, 0.15
_EVIDENCE = 15.0  # log-likelihood
_ONE_TIME = 0.1  # most unexplained share of the acceleration


def cause_and_effect(recording: Recording) -> Iterable[Finding]:
    """Warn of an output that leads its command or lags far behind it.

    Two filters of different width must agree, because an effect that the regression lacks (backlash, presliding
    friction, a spring) changes the best shift by a different amount in each.
    """
    found = profiles(recording)
    if len(found) == 2 and all(profile.slope[profile.best] > 0 for profile in found):
        yield from _lag(recording, found)


def _lag(recording: Recording, found: Sequence[Profile]) -> Iterable[Finding]:
    dt = found[0].sample_time
    lags = [profile.lag for profile in found]
    size = min(abs(lag) for lag in lags)
    if max(lags) - min(lags) > dt + 0.3 * size:
        return
    command, output = recording.name("command"), recording.name("output")
    if min(lags) > _LEAST_SAMPLES * dt + _LEAST_TIME:
        # An offset of the columns has one sharp minimum: zero lag and the double lag fit clearly worse.
        if any(profile.evidence(0.0, 2 * profile.lag) < _EVIDENCE for profile in found):
            return
        whole = round(size / dt + 0.5)
        by = f"{whole} samples ({1e3 * whole * dt:.3g} ms)"
        text = (
            f"{recording.label}: '{output}' answers about {by} before '{command}' acts. A cause comes first: unless "
            f"dry friction or play looks so, '{command}' was recorded late; export both columns on one clock, or move "
            f"'{command}' ahead by {whole} samples or more"
        )
        if recording.servo_gain.any():  # a feedforward of the servo has the same effect
            text = (
                f"{recording.label}: '{output}' answers about {by} before '{command}' acts. If the servo has a "
                "feedforward, switch it off, or name the current or torque as the command; otherwise "
                f"'{command}' was recorded late: export both columns on one clock"
            )
        yield Finding(kind="lag", repaired=False, text=text)
    elif -max(lags) > max(_LONG_SAMPLES * dt, _LONG_TIME):
        # A slow drive lags too, but not by a constant time, so that its residual is larger.
        if any(profile.residual[profile.best] > _ONE_TIME for profile in found):
            return
        if any(profile.evidence(1.5 * profile.lag, 0.5 * profile.lag) < _EVIDENCE for profile in found):
            return
        text = (
            f"{recording.label}: '{output}' answers {1e3 * size:.3g} ms after '{command}', more than the dead time of "
            "a drive; check that both columns were recorded on one clock"
        )
        yield Finding(kind="long lag", repaired=False, text=text)
