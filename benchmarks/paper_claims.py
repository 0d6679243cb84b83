"""Every claim of the paper, repeated, and experiments beyond it: the sentences of all scenarios.

    python benchmarks/paper_claims.py

Writes benchmarks/results/paper_claims.txt. Each is `antidrive simulate NAME` with seed 0.
"""

from __future__ import annotations

import textwrap
from pathlib import Path

from antidrive.scenario_file import read_scenario_file

CLAIMS = {
    "section3": "gear train and speed",
    "figure5": "model and machine under a chirp; equation (5)",
    "section4": "three steps, and alpha",
    "figure6": "dead zone",
    "figure7-samples": "35 samples and 12 at a reversal",
    "dwell": "the same over gaps, preloads and speeds",
    "camera": "a payload moved over a span, a target tracked",
    "fail-safe": "one drive fails, the platform goes on",
    "preload-sizing": "beyond the paper: how much preload is enough",
    "differential": "beyond the paper: the gap and the teeth, measured at standstill",
}


def main() -> None:
    lines = []
    for name, claim in CLAIMS.items():
        result = read_scenario_file(name).run(None, 0)
        lines += [f"{name}: {claim}", ""]
        for sentence in result.sentences():
            lines += textwrap.wrap(sentence, 110, initial_indent="  ", subsequent_indent="    ")
        lines.append("")
    text = "\n".join(lines)
    print(text)
    (Path(__file__).parent / "results" / "paper_claims.txt").write_text(text)


if __name__ == "__main__":
    main()
