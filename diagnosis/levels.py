"""Thresholds of the diagnosis, shared by all modules."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

SURE = 0.9
"""Probability above which a result counts as certain, and share above which it counts as nearly all."""
LIKELY = 0.5
"""Probability above which an effect is reported and in the extended model, and share that counts as about as much."""
CLEARLY = float(np.log(SURE / (1.0 - SURE)))
"""Log Bayes factor that raises a prior probability of 0.5 to `SURE`."""
DECISIVE = float(np.log(1000.0))
"""Log odds of 1000 to 1: margin for linearised evidence and for added curves, and significance of rare events."""
SIGNIFICANT = NormalDist().inv_cdf(1.0 - float(np.exp(-DECISIVE)))
"""Standard errors from which a result is significant: those of a chance of one in 1000, 3.09."""
LEARNING_RATE = 0.7
"""Power of the posterior, below one since no model is exact; learnt from randomly drawn servos."""
INEXACT = 0.01
"""Relative error of models: prior scale of the unmodelled torque, and of the law of an effect."""
