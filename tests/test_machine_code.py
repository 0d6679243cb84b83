"""Machine code gives the same numbers as instructions and the virtual machine; its absence costs time alone."""

from __future__ import annotations

import inspect
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from identification import observer_steps
from plant import ServoModel, file_cache, machine_code, tape_loops
from plant.discrete import Structure
from plant.effects import ActuatorLag, Compliance, InputDelay, StribeckFriction
from plant.effects.effect import Array
from plant.instruction_listing import InstructionListing
from plant.instruction_tape import InstructionTape
from plant.recursion import CHUNK, Recursion
from plant.symbolic import one_at_a_time
from plant.tape_loops import LANES

with_compiler = pytest.mark.skipif(machine_code.compiler() is None, reason="no C compiler here")
ROWS = 2 * CHUNK + 7


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tape_loops.loops()  # for all tests of this process, which would else stay without one
    monkeypatch.setattr(file_cache, "_cache", lambda: tmp_path / "cache")


def example(factor: float = 1.0, kept: str | None = None) -> Recursion:
    """A matrix that turns by each row, and what is seen of it."""
    z, row, constant = ca.SX.sym("z", 2, 3), ca.SX.sym("row", 2), ca.SX.sym("constant")
    turned = ca.vertcat(ca.cos(row[0]) * z[0, :] - z[1, :], ca.sin(row[1]) * z[1, :] + constant * z[0, :])
    seen = factor * ca.sumsqr(z)
    function = ca.Function("example", [z, row, constant], [turned, seen, z[0, :]])
    return Recursion(lambda: function, carried=1, kept=kept)


def followed(recursion: Recursion) -> list[Array]:
    rng = np.random.default_rng(0)
    carried, shown = recursion((rng.normal(size=6),), 0.3 * rng.normal(size=(ROWS, 2)), np.array([0.2]))
    return [*carried, *shown]


def written_out(factor: float = 1.0) -> list[Array]:
    rng = np.random.default_rng(0)
    z = rng.normal(size=6).reshape((2, 3), order="F")
    seen, first = [], []
    for a, b in 0.3 * rng.normal(size=(ROWS, 2)):
        seen.append([factor * np.sum(z**2)])
        first.append(z[0])
        z = np.stack((np.cos(a) * z[0] - z[1], np.sin(b) * z[1] + 0.2 * z[0]))
    return [z.ravel(order="F"), np.array(seen), np.array(first)]


def is_right(recursion: Recursion, factor: float = 1.0) -> bool:
    pairs = zip(followed(recursion), written_out(factor), strict=True)
    return all(np.allclose(found, expected, rtol=1e-12, atol=1e-12) for found, expected in pairs)


@with_compiler
@pytest.mark.parametrize(
    "effect",
    [
        StribeckFriction(coulomb=0.1, excess=0.1, velocity=0.3),
        Compliance(frequency=80.0, damping=0.1, motor_share=0.3),
        ActuatorLag(time_constant=0.0007),
        InputDelay(time=0.003),
    ],
    ids=["one integration step", "several", "at instants of a parameter", "in two parts"],
)
def test_all_forms_agree_to_the_last_bit(effect: object, monkeypatch: pytest.MonkeyPatch) -> None:
    model = ServoModel.paper().with_effect(effect)
    substeps = 5 if isinstance(effect, Compliance) else 1
    time = 0.005 * np.arange(ROWS)
    command, measured = 5.0 * np.sin(8.0 * time), 0.1 * np.sin(7.0 * time)
    constant = np.ones_like(time)
    columns = (
        command,
        command,
        0 * time,
        np.inf * constant,
        time,
        0.005 * constant,
        0 * time,
        0 * time,
        measured,
        0.1 * constant,
        constant,
    )
    begin = (np.resize([0.1, -0.3], len(model.states)), np.eye(6, len(model.states)))
    structure, free = Structure(model), (0, 1, 2, 3)
    builders = {
        "_states": partial(inspect.unwrap(observer_steps._states), structure, substeps, True, "angle"),
        "_derivatives": partial(inspect.unwrap(observer_steps._derivatives), structure, free, substeps, True, "angle"),
        "_sensitivities": partial(inspect.unwrap(observer_steps._sensitivities), len(model.states), 4, 2),
    }
    observer = observer_steps.ObserverSteps(structure=structure, substeps=substeps, positioned=True, response="angle")
    rows, forms = np.column_stack(columns), []
    for form in ("virtual machine", "instructions", "machine code"):
        steps = {name: Recursion(build, carried=int(name != "_derivatives")) for name, build in builders.items()}
        with monkeypatch.context() as patch:
            if form == "virtual machine":
                patch.setattr(InstructionTape, "follow", lambda *_: False)
            for name, step in steps.items():
                patch.setattr(observer_steps, name, lambda *_, step=step: step)
                assert form != "machine code" or step.wait()
            followed = observer.follow(begin[0], rows, model.values)
            slopes = observer.sensitivities(begin[1], followed[2], rows, model.values, free)
        assert all((step._code.library is not None) == (form == "machine code") for step in steps.values())
        forms.append([*followed, *slopes])
    for first, *others in zip(*forms, strict=True):
        assert np.isfinite(first).all()
        assert all(np.array_equal(first, other) for other in others)


def test_rows_stay_in_order_while_the_compiler_works() -> None:
    recursion = example()
    assert is_right(recursion)
    recursion.wait()
    assert is_right(recursion)


@with_compiler
def test_what_is_followed_long_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "plant.recursion.ROWS_BEFORE_COMPILING", 3 * ROWS * len(example()._tape.first) // example()._tape.written
    )
    recursion = example()
    for _ in range(3):
        assert is_right(recursion)
        assert recursion._code.library is None
        assert recursion._code._build is None
    assert is_right(recursion)
    assert recursion._code._build is not None or recursion._code.library is not None  # being compiled, or compiled
    assert recursion._code.wait()
    assert is_right(recursion)
    assert recursion._code.library is not None


@with_compiler
def test_a_thread_that_compiles_waits_for_none_that_waits_for_it() -> None:
    """One needs the function that it compiles, of which only the instructions were kept, while another builds one."""
    example(kept="one")
    compiled = example(kept="one")

    @one_at_a_time
    def build() -> None:
        threading.Thread(target=compiled.wait, daemon=True).start()
        time.sleep(0.3)
        example(2.0)

    builder = threading.Thread(target=build, daemon=True)
    builder.start()
    builder.join(20.0)
    assert not builder.is_alive()
    assert is_right(compiled)


@with_compiler
def test_what_no_row_moves_is_worked_out_once() -> None:
    """The sine of a constant stands before the rows' own instructions, and the numbers are the same."""
    carried, row, constant = (ca.SX.sym(name) for name in ("carried", "row", "constant"))
    still = ca.sin(constant) * ca.exp(constant)
    function = ca.Function("once", [carried, row, constant], [carried + still * row, still * carried])
    tape = InstructionTape.of(function, 1)
    assert tape is not None
    assert tape.counts[: tape.once].sum() == 3
    assert tape.once < len(tape.counts)
    rows, held, shown = np.arange(5.0)[:, None], [np.array([0.5])], [np.empty((5, 1))]
    assert tape.follow(held, rows, [np.array([0.7])], shown)
    factor = np.sin(0.7) * np.exp(0.7)
    before = 0.5 + factor * np.array([0.0, 0.0, 1.0, 3.0, 6.0])
    assert shown[0][:, 0] == pytest.approx(factor * before, rel=1e-14)
    assert held[0] == pytest.approx(0.5 + factor * 10.0, rel=1e-14)


@with_compiler
@pytest.mark.parametrize("form", ["only selected", "also joined", "from pieces"])
def test_what_is_called_is_written_out(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls of calls, with selected elements, matrices with zeros, constants and results that nobody takes."""
    x, scale = ca.SX.sym("x", 3), ca.SX.sym("scale", ca.Sparsity.diag(2))
    inner = ca.Function("inner", [x, scale], [ca.vertcat(ca.sin(x[0] * x[1]), x[2] / 3.0), x**2, ca.cos(x[1])])
    assert inner.nnz_in(1) == 2
    flipped = ca.Function("flipped", [x, scale], [ca.vertcat(x[2], scale[0, 0] - x[0], 0.25), scale[1, 1] * x])
    y, z = ca.MX.sym("y", 3), ca.MX.sym("z", 2, 2)
    _, squares, _ = inner(y, z)
    turned, _ = flipped(squares[[2, 0, 1]], ca.MX.eye(2))
    middle = ca.Function("middle", [y, z], [turned, flipped(turned, z)[1]])
    row, constant, pieces = ca.MX.sym("row", 3), ca.MX.sym("constant", 2, 2), (ca.MX.sym("a"), ca.MX.sym("b", 2))
    one, other = middle(row, constant[:, [0, 1]])
    two, other = middle(ca.vertcat(one[:2], row[0]), constant) if form == "also joined" else middle(other, ca.MX(2, 2))
    shown, given = [one, inner(two, constant)[0], row, other], [row, constant]
    if form == "from pieces":
        u, v = ca.SX.sym("u"), ca.SX.sym("v", 2)
        times = ca.Function("times", [u, v], [u**2, v * u])
        shown, given = [ca.vertcat(*times(*pieces)), pieces[1]], [ca.vertcat(*pieces), constant]
    function = ca.Function("whole", given, shown)
    expanded = list[str]()
    read = InstructionListing._read
    monkeypatch.setattr(InstructionListing, "_read", lambda flat, c: expanded.append(flat.name()) or read(flat, c))
    tape = InstructionTape.of(function, 0)
    assert tape is not None
    assert ("whole" in expanded) == (form == "also joined")  # where there is an operation of matrices
    numbers, shown = np.random.default_rng(3).normal(size=(ROWS, 3)), [np.empty((ROWS, n)) for n in tape.shown]
    values = np.array([[0.7, 9.0], [9.0, -1.3]])
    assert tape.follow([], numbers, [values.ravel(order="F")], shown)
    expected = function.map(ROWS)(numbers.T, np.tile(values, ROWS))
    for found, wanted in zip(shown, expected, strict=True):
        np.testing.assert_array_equal(found, np.array(wanted).T)


@with_compiler
def test_what_is_called_several_times_is_written_once() -> None:
    x, z = ca.SX.sym("x"), ca.MX.sym("z")
    once = ca.Function("once", [x], [ca.sin(ca.cos(x) + x)])
    thrice = ca.Function("thrice", [z], [once(once(once(z)))])
    tape, long = InstructionTape.of(once, 1), InstructionTape.of(thrice, 1)
    assert tape is not None
    assert long is not None
    assert tape.written == once.n_instructions()
    assert len(long.first) == 3 * len(tape.first)
    assert long.written == once.n_instructions() + thrice.n_instructions()
    patience = [Recursion(lambda each=each: each, carried=1)._rows_before_compiling for each in (once, thrice)]
    assert patience[1] < 0.8 * patience[0]  # in which it is followed as long as it takes to compile


OPERATIONS = {
    "of any number": ["sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "asinh", "exp", "expm1", "fabs", "erf"],
    "up to one": ["asin", "acos", "atanh"],
    "above zero": ["log", "log1p", "sqrt"],
    "of steps": ["floor", "ceil", "sign"],
}


@with_compiler
@pytest.mark.parametrize("carried", [0, 1], ids=["many rows at once", "row by row"])
def test_every_operation_is_that_of_the_virtual_machine(carried: int) -> None:
    row, numbers = ca.SX.sym("row", 2), np.random.default_rng(0).normal(size=(ROWS, 2))
    numbers[:6] = [[0.0, -0.0], [-0.0, 0.0], [np.nan, 1.0], [1.0, np.nan], [np.inf, -np.inf], [-1.0, 0.0]]
    x, y = ca.vertsplit(row)
    within, above = x / (1.0 + ca.fabs(x)), ca.fabs(x) + 0.1
    expressions = {"of any number": x, "up to one": within, "above zero": above, "of steps": 3.0 * x}
    results = [getattr(ca, name)(expressions[kind]) for kind, names in OPERATIONS.items() for name in names]
    results += [ca.acosh(1.0 + above), above**y, x**2, x**3, x + y, x - y, x * y, x / y, -x, 1.0 / x, 2.0 * x, x + x]
    results += [x < y, x <= y, x == y, x != y, ca.logic_and(x, y), ca.logic_or(x, y), ca.logic_not(x)]
    results += [ca.fmin(x, y), ca.fmax(x, y), ca.atan2(x, y), ca.hypot(x, y), ca.fmod(x, y), ca.remainder(x, y)]
    results += [ca.copysign(x, y), ca.if_else(x > 0, y, 2.5), row[1], ca.SX(0.25)]
    seen, kept = ca.densify(ca.vertcat(*results)), ca.SX.sym("kept")
    function = ca.Function("every", [kept, row][1 - carried :], [kept, seen][1 - carried :])
    tape = InstructionTape.of(function, carried)
    assert tape is not None
    shown, begin = np.empty((ROWS, len(results))), [np.ones(1)][:carried]
    assert tape.follow(begin, numbers, [], [shown])
    expected = ca.Function("every", [row], [seen]).map(ROWS)(numbers.T)
    np.testing.assert_array_equal(shown, np.array(expected).T)


@with_compiler
@pytest.mark.parametrize("rows", [1, LANES - 1, LANES, LANES + 1, 3 * LANES + 5])
def test_independent_rows_are_executed_together(rows: int) -> None:
    """Many more results than cells: a cell is taken over only when its value is needed no more."""
    row, constant = ca.SX.sym("row", 3), ca.SX.sym("constant")
    values, rng, still = list(ca.vertsplit(row)), np.random.default_rng(3), ca.exp(-(constant**2))
    values.append(values[0] * ca.sin(constant))  # needed only at the beginning of each row
    for _ in range(200):
        one, other = (values[-place] for place in rng.integers(1, 4, size=2))
        values.append(ca.sin(one) * other + still)
    function = ca.Function("long", [row, constant], [values[-1], ca.vertcat(*values[::20]), row[1], constant + 1])
    tape = InstructionTape.of(function, 0)
    assert tape is not None
    assert len(np.unique(tape.results)) < 0.2 * len(tape.results)
    numbers, shown = rng.normal(size=(rows, 3)), [np.empty((rows, size)) for size in tape.shown]
    assert tape.follow([], numbers, [np.array([0.7])], shown)
    expected = function.map(rows)(numbers.T, np.full((1, rows), 0.7))
    for found, other in zip(shown, expected, strict=True):
        np.testing.assert_array_equal(found, np.array(other).T)


@with_compiler
def test_an_operation_that_is_not_known_is_compiled() -> None:
    row = ca.SX.sym("row")
    recursion = Recursion(lambda: ca.Function("inverse", [row], [ca.erfinv(row)]), carried=0)
    assert recursion._tape is None
    _, (shown,) = recursion((), np.linspace(-0.9, 0.9, ROWS)[:, None])
    assert shown[-1, 0] == pytest.approx(1.1630871536766743)


def test_a_function_without_state_is_mapped() -> None:
    row = ca.SX.sym("row", 2)
    mapped = Recursion(lambda: ca.Function("mapped", [row], [ca.sumsqr(row)]), carried=0)
    rows = np.random.default_rng(1).normal(size=(ROWS, 2))
    for _ in range(2):
        assert mapped((), rows)[1][0][:, 0] == pytest.approx((rows**2).sum(axis=1), rel=1e-12)
        mapped.wait()


def test_threads_do_not_disturb_each_other() -> None:
    recursion = example()
    recursion.wait()
    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(is_right, [recursion] * 40))


@with_compiler
@pytest.mark.parametrize("name", ["shown", "rows", "casadi"])
def test_a_function_may_have_any_name(name: str) -> None:
    """One called `shown`, as a variable of the loop is, was compiled anew each time, and each time in vain."""
    row = ca.SX.sym("row", 2)
    assert Recursion(lambda: ca.Function(name, [row], [ca.sumsqr(row)]), carried=0).wait()


@with_compiler
def test_what_was_compiled_is_found_again() -> None:
    first = example()
    assert first._code.library is None  # no compiler has begun
    assert first.wait()
    assert example()._code.library is not None


@with_compiler
def test_what_another_program_has_compiled_meanwhile_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    first, other = example(), example()
    assert first.wait()
    monkeypatch.setattr(machine_code._Build, "start", lambda *_: pytest.fail("it was compiled again"))
    assert other.wait()
    assert is_right(other)


@with_compiler
def test_another_function_of_the_same_name_is_not_taken_for_it() -> None:
    assert example().wait()
    other = example(factor=2.0)
    assert other.wait()
    assert is_right(other, factor=2.0)


@pytest.mark.parametrize("command", [None, ("/bin/false",), ("/nowhere/cc",)])
def test_without_a_working_compiler_the_function_serves(
    command: tuple[str, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine_code, "compiler", lambda: command)
    tape_loops._code.cache_clear()
    recursion = example()
    assert not recursion.wait()
    assert is_right(recursion)
    assert tape_loops._code().library is None
    tape_loops._code.cache_clear()


@with_compiler
def test_a_cache_that_cannot_be_written_costs_only_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(file_cache, "_cache", lambda: tmp_path / "file" / "below")
    recursion = example()
    assert not recursion.wait()
    assert is_right(recursion)


FOREIGN = """
int follow_rows(void) { return 0; }
"""


@with_compiler
@pytest.mark.parametrize("left", [0, 100, 4096, 0.9, b"not a library", FOREIGN], ids=str)
def test_a_damaged_library_is_built_anew(left: float | bytes | str, tmp_path: Path) -> None:
    first = example()
    assert first.wait()
    (path,) = (tmp_path / "cache").glob("*/*.so")
    whole = path.read_bytes()
    if isinstance(left, str):
        (tmp_path / "foreign.c").write_text(left)
        subprocess.run([*machine_code.compiler(), "-shared", "-fPIC", "foreign.c", "-o", str(path)], cwd=tmp_path)
    else:
        # a new file in its place: this process still works with the old one
        path.unlink()
        path.write_bytes(left if isinstance(left, bytes) else whole[: int(left * len(whole)) if left < 1 else left])
    recursion = example()
    assert recursion._code.library is None
    assert is_right(recursion)
    assert recursion.wait()
    assert is_right(recursion)
    assert [kept.read_bytes() for kept in (tmp_path / "cache").glob("*/*.so")] == [whole]


@with_compiler
def test_code_of_another_processor_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A home may be shared by machines of which one lacks instructions of the other: it would end at the first."""
    assert example().wait()
    here = machine_code._for_this_processor
    monkeypatch.setattr(machine_code, "_for_this_processor", lambda command: (here(command)[0], "#define ANOTHER"))
    other = example()
    assert other.wait()
    assert is_right(other)
    assert len(list((tmp_path / "cache").glob("*/*.so"))) == 2


@with_compiler
@pytest.mark.parametrize("answer", ["exit 1", "exec sleep 60"], ids=["refuses", "hangs"])
def test_a_compiler_that_knows_no_processor_serves(
    answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = machine_code.compiler() or ()
    script = tmp_path / "cc"
    script.write_text(f'#!/bin/sh\ncase "$*" in *native*) {answer};; esac\nexec {plain[0]} "$@"\n')
    script.chmod(0o755)
    monkeypatch.setattr(machine_code, "compiler", lambda: (str(script),))
    assert machine_code._for_this_processor((str(script),)) == ((str(script),), "")
    recursion = example()
    assert recursion.wait()
    assert is_right(recursion)


BUILD = """
import multiprocessing, sys
from plant.machine_code import MachineCode

def build():
    global code
    code = MachineCode("example", "int answer(void) { return 42; }")

if __name__ == "__main__":
    worker = multiprocessing.get_context(sys.argv[1]).Process(target=build)
    worker.start()
    worker.join()
    build()
    sys.exit(worker.exitcode)
"""


@pytest.mark.parametrize("method", sorted({"fork", "spawn"} & set(multiprocessing.get_all_start_methods())))
def test_an_early_exit_leaves_no_compiler_files(method: str, tmp_path: Path) -> None:
    folder, script, slow = tmp_path / "here", tmp_path / "build.py", tmp_path / "cc"
    folder.mkdir()
    script.write_text(BUILD)
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o755)
    root = Path(machine_code.__file__).parents[1]
    env = {**os.environ, "CC": str(slow), "TMPDIR": str(folder), "HOME": str(tmp_path), "PYTHONPATH": str(root)}
    env["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    subprocess.run([sys.executable, str(script), method], env=env, check=True, timeout=40)
    assert not [path for path in folder.iterdir() if path.name.startswith("antidrive")]


def test_a_compiler_from_a_wheel_is_used_without_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(machine_code.shutil, "which", lambda name: None)
    monkeypatch.setattr(machine_code, "find_spec", lambda name: name == "ziglang")
    machine_code.compiler.cache_clear()
    found = machine_code.compiler()
    assert found is not None
    assert found[:4] == (sys.executable, "-m", "ziglang", "cc")
    monkeypatch.setenv("CC", "")
    machine_code.compiler.cache_clear()
    assert machine_code.compiler() is None
    machine_code.compiler.cache_clear()


@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
def test_the_compiler_of_the_wheel_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(machine_code.shutil, "which", lambda name: None)
    machine_code.compiler.cache_clear()
    recursion = example()
    assert recursion.wait()
    assert is_right(recursion)
    machine_code.compiler.cache_clear()


@pytest.mark.parametrize("folder", ["plain", "o'brien", 'two words "quoted'])
@pytest.mark.parametrize(
    ("words", "found"), [("", None), ("/gcc", ("/gcc",)), ("/gcc -m64", ("/gcc", "-m64")), ("/none", None)]
)
def test_the_environment_names_the_compiler(
    words: str, found: tuple[str, ...] | None, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / folder
    home.mkdir()
    (home / "gcc").write_text("#!/bin/sh\n")
    (home / "gcc").chmod(0o755)
    machine_code.compiler.cache_clear()
    monkeypatch.setenv("CC", words and f"{home}{words}")
    expected = found and (f"{home}{found[0]}", *found[1:])
    if " -" in words and " " in folder:  # with options it is a line for a shell, which quotes blanks
        expected = None
    assert machine_code.compiler() == expected
    machine_code.compiler.cache_clear()
