"""The answer of a diagnosis: its findings, which can say why they are what they are."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.experiment import Experiment
from diagnosis.explanation import Explanation, explain
from diagnosis.explanation.summary import headline, sentences
from diagnosis.result import Findings
from plant.result_display import Presented


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis(Presented, Findings):
    """The answer to "what does this model get wrong, and why?"."""

    def explain(self, experiment: Experiment | None = None) -> Explanation:
        """Why each name won and by what margin, or why there is none, in sentences and pictures.

        Args:
            experiment: that has been designed to tell the rivals of this diagnosis apart, if any.
        """
        return explain(self, experiment)

    def __str__(self) -> str:
        """The verdict, the causes with odds and sizes, the gain, what remains, and the warnings, a line each."""
        return "\n  ".join((headline(self), *sentences(self), *self.warnings))

    def __repr__(self) -> str:
        """The verdict in one sentence."""
        return f"Diagnosis({self.verdict}: {headline(self)})"
