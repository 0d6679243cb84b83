"""What an extended model brings in the loop, on the machine that made the log.

The whole table is printed by benchmarks/control_gain.py.
"""

from __future__ import annotations

from functools import cache
from statistics import fmean

import pytest
from closed_machine import Tracking, swing, track
from hidden_effects import CASES
from machine import Machine, excitation, record

from identification.fit import fit
from plant import ServoModel, catalogue

END = 10.0  # of the log [s]; the loop goes on from there
FINE = 2e-5  # noise of a good encoder [rad]
UNRESOLVED = 1e-5  # a fifth of a count of the encoder [rad]
SIZES = {case.effect: case.at(case.sizes[2]) for case in CASES}
SIZES["input_delay"] = {"time": 0.02}
SIZES["payload_change"] |= {"time": 4.0}


@cache
def informed(effect: str | None) -> Tracking:
    """The loop with the true model; None: of the machine that hides nothing."""
    machine, truth = Machine(), ServoModel.paper()
    if effect:
        machine = machine.hiding(**{effect: SIZES[effect]})
        truth = truth.with_effect(catalogue[effect](**SIZES[effect])).without_clock(END)
    return track(machine, truth, swing, 5.0, begin=END, noise=FINE)


def ignorant(effect: str) -> Tracking:
    """The loop with the base model, fitted to a log of the machine."""
    machine = Machine().hiding(**{effect: SIZES[effect]})
    base = fit(record(machine, excitation(13, duration=END)).log()).model
    return track(machine, base, swing, 5.0, begin=END, noise=FINE)


@pytest.mark.parametrize(
    ("effect", "share"),
    [
        ("coulomb_friction", 0.6),
        ("input_delay", 0.05),
        ("cogging", 0.5),
        ("back_emf", 0.7),
        ("encoder_eccentricity", 0.05),
    ],
)
def test_a_model_that_knows_the_effect_follows_better(effect: str, share: float) -> None:
    assert informed(effect).rms < share * ignorant(effect).rms


@pytest.mark.parametrize("effect", ["torque_offset", "payload_change", "periodic_disturbance"])
def test_nobody_follows_worse_for_knowing_more(effect: str) -> None:
    assert informed(effect).rms < 1.05 * ignorant(effect).rms + UNRESOLVED


@pytest.mark.parametrize("effect", ["input_delay", "back_emf", "encoder_eccentricity"])
def test_what_is_known_and_can_be_undone_costs_nothing(effect: str) -> None:
    assert informed(effect).rms < 1.2 * informed(None).rms + UNRESOLVED
    assert informed(effect).degraded == 0


@pytest.mark.parametrize("effect", ["input_delay", pytest.param("actuator_lag", marks=pytest.mark.long)])
def test_so_it_is_with_the_loop_that_each_model_gets_by_default(effect: str) -> None:
    chosen = {"bandwidth": None, "horizon": None, "disturbance_rate": None, "torque_noise": 0.0}
    machine, base = Machine().hiding(**{effect: SIZES[effect]}), ServoModel.paper()
    knows = base.with_effect(catalogue[effect](**SIZES[effect]))
    informed, ignorant = (  # the dead zone makes the error of a single run a matter of luck: 2e-5 to 6e-5 with each
        fmean(track(machine, model, swing, 5.0, seed=seed, begin=END, noise=FINE, **chosen).rms for seed in range(8))
        for model in (knows, base)
    )
    assert informed < 1.05 * ignorant + UNRESOLVED
    assert informed < 1e-4
