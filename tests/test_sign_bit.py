"""Signed values that were stored without their sign are read with it, and others are left as they are."""

from __future__ import annotations

import numpy as np
import pytest
from sample_logs import motion

from identification import Log
from identification.reading.sign_bit import signed

SOUND = motion(samples=600)
WAVE = np.round(400.0 * SOUND["torque"] / np.abs(SOUND["torque"]).max())


@pytest.mark.parametrize("bit", [10, 11, 15])
def test_a_magnitude_with_a_sign_bit(bit):
    values, how = signed(np.where(WAVE < 0, 2.0**bit - WAVE, WAVE))
    np.testing.assert_array_equal(values, WAVE)
    assert how == f"has its sign in bit {bit}"


@pytest.mark.parametrize("bits", [16, 32])
def test_a_signed_number_that_was_read_as_unsigned(bits):
    values, how = signed(WAVE % 2.0**bits)
    np.testing.assert_array_equal(values, WAVE)
    assert how == f"is a signed number of {bits} bits"


@pytest.mark.parametrize(
    "values",
    [
        WAVE,  # has its sign
        WAVE + 512.0,  # about the middle of a converter's range
        np.abs(WAVE),
        np.where(WAVE > 0, 1100.0, 0.0),  # a command of two levels
        np.repeat([0.0, 100.0, 200.0, 300.0, 400.0, 1100.0], 100),
        WAVE % 2.0**16 + 0.5,  # no whole numbers
        np.zeros(600),
        np.full(600, np.nan),
    ],
)
def test_other_values_are_left_as_they_are(values):
    found, how = signed(values)
    np.testing.assert_array_equal(found, values)
    assert how == ""


def test_a_log_says_how_its_command_was_stored():
    stored = np.where(WAVE < 0, 1024.0 - WAVE, WAVE)
    log = Log.from_arrays(time=SOUND["time"], angle=SOUND["angle"], duty=stored, scales={"duty": 1e-3})
    np.testing.assert_allclose(log.runs[0].command, 1e-3 * WAVE)
    assert any("'duty' has its sign in bit 10, and is read so" in warning for warning in log.warnings)
