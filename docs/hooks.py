"""The pages that nobody writes: gallery, notebooks, reference, and the documents of the top folder."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from markupsafe import escape
from mkdocs.structure.files import File, Files

import antidrive
from antidrive.cli import app, main
from antidrive.collinearity import absorbed_share, collinear_share
from antidrive.equations import typeset
from antidrive.gallery import bounds, paragraphs, units
from antidrive.signature import Signature, signature
from diagnosis.explanation.wording import percent, sentence_case
from plant.effects import Effect, Stage, catalogue

ROOT = Path(__file__).parents[1]
PACKAGES = ("plant", "allocation", "identification", "diagnosis", "mpc")


def on_config(config: Any) -> Any:
    """Name the notebooks, of which there may be any number, in the menu."""
    listed = [{title(path): f"notebooks/{path.stem}.md"} for path in sorted((ROOT / "notebooks").glob("*.ipynb"))]
    config.nav = [{"Notebooks": listed} if "Notebooks" in entry else entry for entry in config.nav]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages to those of the folder."""
    for path, content in pages():
        files.append(File.generated(config, path, content=content))
    return files


def pages() -> Iterator[tuple[str, str]]:
    """Path and content of each page and picture."""
    for name in ("CHANGELOG", "CONTRIBUTING"):
        yield f"{name.lower()}.md", (ROOT / f"{name}.md").read_text(encoding="utf-8")
    yield "gallery.md", gallery()
    for name, kind in catalogue.items():
        if found := signature(kind):
            yield f"gallery/{name}.svg", picture(found)
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        yield f"notebooks/{path.stem}.md", notebook(path)
    for package in PACKAGES:
        yield f"reference/{package}.md", reference(package)
    yield "reference/antidrive.md", front_door()
    yield "reference/commands.md", commands()


# Gallery.


def gallery() -> str:
    """Every effect by its stage."""
    parts = [
        "# Gallery of effects",
        "Each effect is simulated on the paper's servo, without noise and at a size that shows, while a slow chirp, "
        "steps and a fast chirp are played into it. Two shares are given, to first order: how much of its signature a "
        "refit of the other parameters absorbs, and how much of the rest a confused effect could absorb. "
        "`antidrive effects` makes this page with pictures that zoom.",
    ]
    for stage in Stage:
        kinds = [kind for kind in catalogue.values() if kind.stage is stage]
        parts += [f"## {sentence_case(stage.value)}", *(effect(kind) for kind in kinds)]
    return "\n\n".join(parts)


def effect(kind: type[Effect]) -> str:
    """One effect: equation, words, parameters, picture, confused effects."""
    found = signature(kind)
    scrolled = f'<div style="overflow: auto hidden">{typeset(kind.equation)}</div>'  # on a phone, not the whole page
    lines = [f"### {sentence_case(kind.title)} {{ #{kind.name} }}", scrolled]
    lines += [str(escape(part)).replace("&#39;", "'") for part in paragraphs(kind)]
    lines += [f"Shows as: {escape(kind.signature)}.", "| `" + kind.name + "` | unit | bounds | |\n|---|---|---|---|"]
    lines[-1] += "".join(
        f"\n| `{spec.name}` | {units(kind, spec)} | {bounds(spec)} | {spec.meaning} |" for spec in kind.parameters()
    )
    if found is not None:
        lines.append(f"![{kind.title}: what the model lacks, and what changes](gallery/{kind.name}.svg)")
        lines.append(
            f"A refit of the model absorbs {percent(absorbed_share(found.effect, found.excitation))} of its signature."
        )
    near = [
        (catalogue[name], collinear_share(kind, catalogue[name])) for name in kind.confused_with if name in catalogue
    ]
    links = [f"[{k.title}](#{k.name})" + (f" ({percent(share)})" if share is not None else "") for k, share in near]
    if links:
        lines.append(f"Confused with, and how much of the rest that could absorb: {', '.join(links)}.")
    return "\n\n".join(lines)


def picture(found: Signature) -> str:
    """What the model lacks over the variable that tells, and the change of the measurement over time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    grey, every = "#8a8a8a", slice(None, None, 3)
    flows = {"torque": "torque [N m]", "angle": "angle [rad]", "velocity": "velocity [rad/s]", "time": "time [s]"}
    lacking = "measurement error [rad]" if found.effect.stage is Stage.SENSOR else "residual torque [N m]"
    style = dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), grey)
    with matplotlib.rc_context({**style, "font.size": 8, "svg.fonttype": "none", "svg.hashsalt": found.effect.name}):
        figure, (left, right) = pyplot.subplots(1, 2, figsize=(7.2, 2.2), layout="constrained")
        line = {"linewidth": 0.8} if found.variable == "time" else {"linestyle": "", "marker": ".", "markersize": 1.5}
        left.plot(found.variables[found.variable][every], found.lacking[every], color="#d1603d", **line)
        left.set(xlabel=flows[found.variable], ylabel=lacking)
        right.plot(found.variables["time"][every], 1e3 * found.change[every], linewidth=0.8, color="#2a7f9e")
        right.set(xlabel="time [s]", ylabel="change of the measurement [mrad]")
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
        pyplot.close(figure)
    return drawn.getvalue()


# Notebooks.


def title(path: Path) -> str:
    """The first heading of a notebook."""
    return re.search(r"^# (.+)$", _markdown(path), re.MULTILINE)[1]  # type: ignore[index]


def _markdown(path: Path) -> str:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def notebook(path: Path) -> str:
    """A notebook as it was executed: text, code, what it printed and drew."""
    parts = [f"*`notebooks/{path.name}`*"]
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif cell["cell_type"] == "code":
            parts.append(f"```python\n{source}\n```")
            parts += [shown for output in cell["outputs"] if (shown := _output(output))]
    return "\n\n".join([parts[1], parts[0], *parts[2:]])


def _output(output: dict[str, Any]) -> str:
    data = output.get("data", {})
    if "image/png" in data:
        return f'<img alt="" src="data:image/png;base64,{"".join(data["image/png"]).replace(chr(10), "")}">'
    text = "".join(output.get("text", data.get("text/plain", "")))
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""


# Reference.


def reference(package: str) -> str:
    """Every public name of a package, from its docstring, under the name by which it is imported."""
    module = importlib.import_module(package)
    parts = [f"# {package}", module.__doc__ or ""]
    for name in module.__all__:
        home = getattr(getattr(module, name), "__module__", "")  # where it stands: a module may share its name
        if home.split(".")[0] == package:  # and no alias of a type
            parts.append(f"::: {home}.{name}\n    options:\n      heading: {package}.{name}\n      toc_label: {name}")
    return "\n\n".join(parts) + "\n"


def front_door() -> str:
    """The names of `import antidrive as ad`, each with its first sentence and its package."""
    text = inspect.cleandoc(antidrive.__doc__ or "")
    rows = ["| name | what it is | from |", "|---|---|---|"]
    for name, home in antidrive.HOMES.items():
        exported = getattr(antidrive, name)
        first = (inspect.getdoc(exported) or "").split("\n")[0] if callable(exported) else "Every effect by its name."
        package = home.split(".")[0]
        link = f"[{package}]({package}.md)" if package in PACKAGES else package
        rows.append(f"| `ad.{name}` | {first.replace('|', ', ')} | {link} |")
    own = [
        f"::: antidrive.prediction.{name}\n    options:\n      heading: antidrive.{name}\n      toc_label: {name}"
        for name in ("predict", "Prediction")
    ]
    return "\n\n".join(("# antidrive", text, "\n".join(rows), *own)) + "\n"


def commands() -> str:
    """What `--help` says of each command."""
    codes = "0: done; 2: bad input, reported in one sentence on stderr; 130 or 143: stopped; 1: anything else."
    parts = ["# Commands", f"Exit code {codes}"]
    for command in app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            main([name, "--help"])
        parts += [f"## antidrive {name}", f"```text\n{output.getvalue().strip()}\n```"]
    return "\n\n".join(parts)
