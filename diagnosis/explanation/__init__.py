"""Explanation of a diagnosis in words: the causes and their evidence, with plots."""

from __future__ import annotations

from diagnosis.explanation.paragraphs import Explanation, explain
from diagnosis.explanation.reasons import Reason

__all__ = ["Explanation", "Reason", "explain"]
