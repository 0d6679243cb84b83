"""Jitter of time stamps: the drive samples evenly, the logger stamps the samples when they arrive.

Either the time stamps are true or the samples are evenly spaced. With the wrong times the load seems to be disturbed at
random, so the model is fitted with both. Even times are used where their likelihood is clearly higher.
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
_SCATTER = 0.005  # of a sample time: standard deviation from which the jitter matters
_NEAR = 0.5  # of a sample time: stamps further off the even clock are not jitter


def with_its_clock(fit: Fit) -> Fit:
    """The model fitted to the log with even times if that is clearly more likely, else the unchanged fit."""
    even = evenly_timed(fit.log)
    if even is fit.log:
        return fit
    found = Problem.of(even, fit.model, known=fit.known).solve()
    return found if found.log_likelihood > fit.log_likelihood + _CLEARLY else fit


def evenly_timed(log: Log) -> Log:
    """The log with evenly spaced samples in each run; the log itself if they are even already or no even clock fits."""
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
    """Mean time step without gaps [s]: a clock with it does not drift against the time stamps."""
    steps = np.diff(time)
    usual = steps[steps < 1.5 * np.median(steps)]
    return float(np.mean(usual))
