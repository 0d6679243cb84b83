"""What a user passes by mistake ends in one sentence, and what is meant is taken."""

from pathlib import Path

import pytest
from machine import Machine, excitation, record

import antidrive as ad
from diagnosis import diagnose
from identification import Log, fit
from plant import ServoModel, drive_table, simulate
from plant.errors import BadModelFile, BadParameter

LOG = record(Machine(), excitation(4, duration=5.0), seed=4).log()


def test_a_model_may_be_the_path_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    ad.write_model(ServoModel(inertia=2.0), path)
    assert fit(LOG, path).model.inertia == fit(LOG, ServoModel(inertia=2.0)).model.inertia
    assert len(ad.predict(path, LOG).to_frame()) == len(LOG.runs[0])
    assert drive_table(path, "friction").points == 64
    with pytest.raises(BadModelFile, match="cannot be read"):
        drive_table(tmp_path / "other.json", "friction")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit(LOG, 3), "This needs a model"),
        (lambda: diagnose(LOG, candidates="cogging"), "candidates is one text; give a list"),
        (lambda: diagnose(LOG, exclude="cogging"), "exclude is one text; give a list"),
        (lambda: fit(LOG, per_run="inertia"), "per_run is one text; give a list"),
        (lambda: Log.read(None), "Log.read needs the path of a file"),
        (lambda: Log.read([3]), "Log.read needs the path of a file"),
        (lambda: simulate(ServoModel(), command=[0.1, 0.2], dt=-1.0), "dt must be a positive number"),
        (lambda: simulate(ServoModel(), command=[0.1, float("nan")], dt=0.01), "command must be a list of finite"),
        (lambda: simulate(ServoModel(), command=[], dt=0.01), "command must be a list of finite"),
        (lambda: simulate(ServoModel(), command=[0.1], dt=0.01, state=[0.0]), "state must be 2 finite numbers"),
        (lambda: drive_table(ServoModel(), "friction", points="64"), "a whole number, not '64'"),
        (lambda: drive_table(ServoModel(), "friction", points=2.5), "a whole number, not 2.5"),
        (lambda: drive_table(ServoModel(), "friction", reach=5), "reach: give the first and the last value"),
        (lambda: drive_table(ServoModel(), "friction", reach=(1.0, float("nan"))), "reach: give the first and"),
        (lambda: drive_table(ServoModel(), ["friction"]), "There is no table"),
        (lambda: drive_table(3, "friction"), "This needs a model"),
        (lambda: ad.compare(3, LOG), "This needs a model"),
    ],
)
def test_a_mistake_ends_in_one_sentence(call, message: str) -> None:
    with pytest.raises(BadParameter, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
