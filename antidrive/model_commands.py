"""What leaves a model for other tools: the feed-forward of a drive."""

from __future__ import annotations

from pathlib import Path

from antidrive.output import whole_folder, written
from antidrive.own_effects import read_identified
from antidrive.voice import Voice


def feedforward(model: Path, *, single: bool, effects: Path | None, out: Path, voice: Voice) -> None:
    """Write the inverse model as C99 and Structured Text."""
    from plant.feedforward import feedforward_code

    made = feedforward_code(read_identified(model, effects).model, single=single)
    with whole_folder(out) as draft:
        for name, text in made.files.items():
            (draft / name).write_text(text, encoding="utf-8")
    voice.result("\n".join([*made.sentences(), written(out, ", ".join(made.files))]), made.summary())
