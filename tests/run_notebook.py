"""A notebook run as Jupyter runs it, but in this process.

`python tests/run_notebook.py 02` runs notebooks/02_*.ipynb and saves what its cells put out.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "notebooks"
WIDGET = "application/vnd.jupyter.widget-view+json"
Output = dict[str, Any]


@contextmanager
def shell() -> Iterator[Any]:
    """An IPython shell that draws like a notebook's, in the folder of the notebooks, on their bundled data."""
    import matplotlib
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.core.pylabtools import select_figure_formats
    from matplotlib import pyplot
    from traitlets.config import Config

    backend, emps = matplotlib.get_backend(), os.environ.pop("EMPS", None)
    matplotlib.use("Agg")
    made = InteractiveShell.instance(config=Config(HistoryManager={"hist_file": ":memory:"}))
    select_figure_formats(made, {"png"})
    try:
        sys.path.insert(0, str(FOLDER))
        with chdir(FOLDER), matplotlib.rc_context():
            yield made
    finally:
        sys.path.remove(str(FOLDER))
        pyplot.close("all")
        matplotlib.use(backend)
        made.history_manager.end_session()
        InteractiveShell.clear_instance()
        if emps is not None:
            os.environ["EMPS"] = emps


def outputs(made: Any, source: str) -> list[Output]:
    """What a cell puts out, in the form of a notebook file; an error is raised."""
    from IPython.display import display
    from IPython.utils.capture import capture_output
    from matplotlib import pyplot

    with capture_output() as caught:
        done = made.run_cell(source, store_history=True)
        for number in pyplot.get_fignums():
            display(pyplot.figure(number))
        pyplot.close("all")
    done.raise_error()
    printed = [{"output_type": "stream", "name": "stdout", "text": caught.stdout.splitlines(keepends=True)}]
    shown = [
        {"output_type": "update_display_data" if one.update else "display_data"}
        | {"data": one.data, "metadata": {}, "transient": one.transient or {}}
        for one in caught.outputs
    ]
    return (printed if caught.stdout.strip() else []) + shown


def cells(path: Path) -> list[dict[str, Any]]:
    """All cells of a notebook file."""
    return list(json.loads(path.read_text(encoding="utf-8"))["cells"])


def save(path: Path) -> None:
    """Run a notebook and keep in its file what it puts out."""
    content = json.loads(path.read_text(encoding="utf-8"))
    with shell() as made:
        for cell in content["cells"]:
            if cell["cell_type"] == "code":
                cell["outputs"] = [kept(output) for output in outputs(made, "".join(cell["source"])) if lasts(output)]
                print(*(line for o in cell["outputs"] for line in o.get("text", ())), sep="", end="", flush=True)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def lasts(output: Output) -> bool:
    """Whether an output says something once the kernel is gone: neither a widget nor what changed an earlier output."""
    return output["output_type"] != "update_display_data" and WIDGET not in output.get("data", {})


def kept(output: Output) -> Output:
    """An output as a file keeps it."""
    return {key: value for key, value in output.items() if key != "transient"}


if __name__ == "__main__":
    for name in sys.argv[1:]:
        save(next(FOLDER.glob(f"{name}*.ipynb")))
