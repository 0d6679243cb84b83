"""Written times that scatter about an even clock: a drive samples evenly, the logger beside it stamps what it gets.

Both readings of such a log are possible: the samples were taken when it says, or evenly. The model tells: with the
wrong times the load seems to be pushed at random. The likelier reading is used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from identification.recording import Array
from identification.run import Run

_CLEARLY = 10.0  # rise of the log-likelihood from which the stamps are rejected
_SCATTER = 0.005  # of a sample: the standard deviation from which it matters
_NEAR = 0.5  # of a sample: stamps further off the even clock are not scatter


def with_its_clock(fit: Fit) -> Fit:
    """The same model fitted to the log with its samples at even times, or the fit as it is."""
    even = evenly_timed(fit.log)
    if even is fit.log:
        return fit
    found = Problem.of(even, fit.model, known=fit.known).solve()
    return found if found.log_likelihood > fit.log_likelihood + _CLEARLY else fit


def evenly_timed(log: Log) -> Log:
    """The log with its runs on even clocks; the log itself where they are even already or no such clock is near."""
    runs = tuple(_even(run) for run in log.runs)
    off = [np.abs(new.time - old.time).max() for new, old in zip(runs, log.runs, strict=True)]
    if not any(off):
        return log
    sentence = (
        f"The time stamps jitter by up to {1e3 * max(off):.2g} ms, but the motion fits evenly spaced samples better: "
        "even times are used"
    )
    return replace(log, runs=runs, repairs=(*log.repairs, sentence), evenly_timed=True)


def _even(run: Run) -> Run:
    places = np.round((run.time - run.time[0]) / _step(run.time))
    steps = np.diff(places)
    if np.any(steps < 1):
        return run
    clock = np.polynomial.Polynomial.fit(places, run.time, 1)(places)
    off = (run.time - clock) / run.sample_time
    if np.std(off) < _SCATTER or np.max(np.abs(off)) > _NEAR:
        return run
    return replace(run, time=clock)


def _step(time: Array) -> float:
    """Time step of a clock that gains nothing over the stamps in the long run [s]."""
    steps = np.diff(time)
    usual = steps[steps < 1.5 * np.median(steps)]
    return float(np.mean(usual))
