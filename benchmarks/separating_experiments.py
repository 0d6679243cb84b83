"""Confounded pairs: duration of a plain chirp and of the designed experiment that separates them.

    python benchmarks/separating_experiments.py [number of a pair ...]

An independent machine hides a little of the first effect of a pair and records short, slow chirps. The first few logs
are taken that show the effect but leave both candidates open. For each an experiment is designed, applied to the
machine and recorded with several seeds of the noise, and both models are refitted to log and experiment. An experiment
separates the pair if the right effect has a probability above 0.9 in 95 % of all cases. The same is done with plain
chirps, 0.1 to 5 Hz at the amplitude within the same limits with the highest predicted evidence. The designed experiment
gets half of the duration of the chirp, and more only if that fails; durations increase by a half and a third in turn.
Prints the table and writes it to benchmarks/results/separating_experiments.txt.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from confusable_pairs import PAIRS, Pair

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Machine, chirp, record  # noqa: E402

from diagnosis import Limits  # noqa: E402
from diagnosis.experiment.separation import CompetingModel  # noqa: E402
from diagnosis.experiment.signal_design import Design, Found  # noqa: E402
from diagnosis.levels import SURE  # noqa: E402
from identification.fit import fit  # noqa: E402
from identification.fit_result import Fit  # noqa: E402
from identification.log import Log  # noqa: E402
from identification.problem import Problem  # noqa: E402
from plant import ServoModel, catalogue  # noqa: E402

LIMITS = Limits(torque=4.0, speed=5.0, travel=(-4.0, 4.0))
SAMPLE_TIME = 0.005
DURATIONS = (
    0.5,
    0.75,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    6.0,
    8.0,
    12.0,
    16.0,
    24.0,
    32.0,
    48.0,
    64.0,
)  # half: two entries before
NAMED = float(np.log(SURE / (1.0 - SURE)))  # log odds
LOGS, SEEDS = 4, 10  # logs that leave the pair open, and experiments after each
CASES, SHARE = LOGS * SEEDS, 0.95
SEEN = 5.0  # gain in log-likelihood of the hidden effect, from which a log shows it
WIDE = 30.0  # observer bandwidth for a restart of the less probable model [rad/s]


HEADER = (
    f"{'hidden':24}{'rival':24}{'in the logs':>14}{'settled after [s]':>20}{'':7}{'named, of':>10}{'s for a':>10}\n"
    f"{'':48}{'seen':>8}{'odds':>6}{'chirp':>11}{'design':>9}{'share':>7}{CASES:10}{'design':>10}"
    "  the first signal was made of"
)


@dataclass(frozen=True, kw_only=True)
class Contest:
    """A machine, a log of it that leaves two models open, and the fits of both, the right one first."""

    machine: Machine
    log: Log
    fits: tuple[Fit, Fit]

    @classmethod
    def of(cls, pair: Pair, seed: int) -> Contest:
        machine = Machine().hiding(**{pair.hidden: pair.values})
        command = chirp(pair.amplitude, 0.05, 1.0, pair.duration, SAMPLE_TIME)
        log = record(machine, command, seed=seed, sample_time=SAMPLE_TIME).log()
        paper = ServoModel.paper()
        right = fit(log, paper.with_effect(catalogue[pair.hidden](**pair.values)))
        wrong = fit(log, paper.with_effect(catalogue[pair.alternative](**pair.start)))
        return cls(machine=machine, log=log, fits=(right, wrong))

    @property
    def log_odds(self) -> float:
        """Log odds of the right model on the log alone."""
        return evidence(self.fits[0]) - evidence(self.fits[1])

    @property
    def seen(self) -> float:
        """Gain in log-likelihood of the hidden effect."""
        return self.fits[0].log_likelihood - fit(self.log).log_likelihood

    def design(self, duration: float) -> Design:
        """The design task for a duration."""
        return Design(
            competing=(CompetingModel.of(self.fits[0]), CompetingModel.of(self.fits[1])),
            limits=LIMITS,
            duration=duration,
            sample_time=SAMPLE_TIME,
            start=float(self.fits[0].initial[0, 0]),
        )

    def played(self, found: Found) -> Iterator[bool]:
        """Whether the right effect is reported after a signal, for each seed of the noise."""
        commands = np.repeat(found.torque[:, None], SEEDS, axis=1)
        angle = self.fits[0].initial[0, 0]
        records = record(self.machine, commands, seed=100, angle=angle, sample_time=SAMPLE_TIME).logs()
        return (self.final_odds(experiment) >= NAMED for experiment in records)

    def final_odds(self, experiment: Log) -> float:
        """Log odds of the right model after an experiment.

        The less probable model may be refitted with a wide observer bandwidth. If the right model is then not accepted,
        it may be in a local optimum: both are refitted with a wide bandwidth, from their own values and the other's.
        """
        log = Log.merge([self.log, experiment])
        at_rest = [[experiment.runs[0].output[0], 0.0]]
        starts = [replace(found, initial=np.vstack((found.initial, at_rest))) for found in self.fits]
        problems = [Problem.of(log, found.model) for found in self.fits]
        best = [problem.descend(start) for problem, start in zip(problems, starts, strict=True)]

        def again(place: int, start: Fit) -> None:
            found = problems[place].descend(replace(start, bandwidth=max(start.bandwidth, WIDE)))
            best[place] = max(best[place], found, key=evidence)

        behind = int(evidence(best[0]) > evidence(best[1]))
        again(behind, starts[behind])
        if evidence(best[0]) - evidence(best[1]) < NAMED:
            again(1 - behind, starts[1 - behind])
            for place, other in enumerate(reversed(best.copy())):
                again(place, other)
        return evidence(best[0]) - evidence(best[1])


def evidence(found: Fit) -> float:
    return found.log_likelihood - 0.5 * len(found.free) * float(np.log(found.samples))


def contests(number: int) -> list[Contest]:
    """Logs of a pair that show a missing effect and leave both candidates open."""
    tried = (Contest.of(PAIRS[number], 1000 * number + seed) for seed in range(10 * LOGS))
    return list(islice((c for c in tried if abs(c.log_odds) < NAMED and c.seen > SEEN), LOGS))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Signals for all logs of a pair, number of cases in which the right effect is reported, and the design time."""

    signals: list[Found]
    named: int
    seconds: float

    @property
    def settled(self) -> bool:
        return self.named >= SHARE * CASES

    @classmethod
    def of(cls, found: list[Contest], make: Callable[[Design], Found | None], duration: float) -> Outcome:
        """For a method of signal generation; it stops as soon as too many cases have failed."""
        signals: list[Found] = []
        named = missed = 0
        seconds = 0.0
        for contest in found:
            started = time.perf_counter()
            signal = make(contest.design(duration))
            seconds += time.perf_counter() - started
            if signal is None:
                missed += SEEDS
                continue
            signals.append(signal)
            for right in contest.played(signal):
                named, missed = named + right, missed + (not right)
                if missed > (1.0 - SHARE) * CASES:
                    return cls(signals=signals, named=named, seconds=seconds / len(signals))
        return cls(signals=signals, named=named, seconds=seconds / max(len(signals), 1))


def row(number: int) -> tuple[bool, str]:
    """One pair: whether half the duration of a chirp is enough, and the line of the table."""
    found = contests(number)
    head = f"{PAIRS[number]}{np.mean([c.seen for c in found]):8.1f}{np.mean([c.log_odds for c in found]):6.1f}"
    if len(found) < LOGS:
        return False, f"{head}  only {len(found)} logs name neither"
    sweep = next((t for t in DURATIONS[2:] if Outcome.of(found, Design.plain_chirp, t).settled), np.inf)
    rung = (DURATIONS.index(sweep) if sweep < np.inf else len(DURATIONS)) - 2
    for place in range(rung, rung + 3 if sweep < np.inf else rung + 1):
        best = Outcome.of(found, design, DURATIONS[place])
        if best.settled:
            break
    duration = DURATIONS[place]
    settled, swept = (f"{duration:g}" if best.settled else "never"), (f"{sweep:g}" if sweep < np.inf else "never")
    share = f"{duration / sweep:.2f}" if best.settled and sweep < np.inf else "-"
    line = f"{head}{swept:>11}{settled:>9}{share:>7}{best.named:10}{best.seconds:10.1f}  {best.signals[0].signal}"
    return best.settled and place == rung and sweep < np.inf, line


def design(task: Design) -> Found:
    return task.best(seed=0)


def main() -> None:
    chosen = [int(place) for place in sys.argv[1:]] or list(range(len(PAIRS)))
    lines = [HEADER]
    print(HEADER)
    halves = 0
    for number in chosen:
        half, line = row(number)
        halves += half
        lines.append(line)
        print(line, flush=True)
    lines.append(f"at most half the duration of a plain chirp settles {halves} of {len(chosen)} pairs")
    print(lines[-1])
    if len(chosen) == len(PAIRS):
        folder = HERE / "results"
        folder.mkdir(exist_ok=True)
        (folder / "separating_experiments.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
