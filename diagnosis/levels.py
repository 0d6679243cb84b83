"""The levels from which something is said, or left out: the same ones everywhere."""

from __future__ import annotations

import numpy as np

SURE = 0.9
"""Probability from which something is sure, and share from which it is nearly all; what is left is next to nothing."""
LIKELY = 0.5
"""Probability from which an effect is told, and is in the model: then it is likelier there than not."""
CLEARLY = float(np.log(SURE / (1.0 - SURE)))
"""Log Bayes factor that makes sure of what was as likely as not."""
HARDLY_EVER = float(np.log(1000.0))
"""Log odds against what hardly ever comes: odd values, a curve that nobody asked for, or a promise that is so wrong."""
SURELY = 3.0
"""Standard errors from which validation data speak for or against something."""
TWICE = 1.0
"""Rise of an error from which it is another one."""
INEXACT = 0.01
"""Share by which laws and models are wrong: of a torque no name explains, and of an effect its own law."""
