"""The result of a diagnosis: its findings, with an explanation."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.experiment import Experiment
from diagnosis.explanation import Explanation, explain
from diagnosis.explanation.summary import headline, sentences
from diagnosis.result import Findings
from plant.result_display import Drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis(Drawn, Findings):
    """The result of a diagnosis: which effects the model lacks, and the evidence for them."""

    def explain(self, experiment: Experiment | None = None) -> Explanation:
        """Explain the causes and their evidence, or why there is none, in sentences and plots.

        Args:
            experiment: designed to separate the competing sets of this diagnosis, if any.
        """
        return explain(self, experiment)

    def __str__(self) -> str:
        """The verdict, the causes with probabilities and sizes, the gain, the remaining error, and the warnings."""
        return "\n  ".join((headline(self), *sentences(self), *self.warnings))

    def __repr__(self) -> str:
        """The verdict in one sentence."""
        return f"Diagnosis({self.verdict}: {headline(self)})"
