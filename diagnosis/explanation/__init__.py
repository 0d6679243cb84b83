"""A diagnosis in words: why a name won and by what margin, with the pictures that show it."""

from __future__ import annotations

from diagnosis.explanation.paragraphs import Explanation, explain
from diagnosis.explanation.reasons import Reason

__all__ = ["Explanation", "Reason", "explain"]
