"""Diagnosis: what the model misses, by name, with proof."""

from __future__ import annotations

from diagnosis.diagnose import diagnose
from diagnosis.result import Cause, Diagnosis, Gain

__all__ = ["Cause", "Diagnosis", "Gain", "diagnose"]
