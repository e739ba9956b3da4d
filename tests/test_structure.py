"""The module reads top to bottom, its examples are true, the figures and the README
run."""

import ast
import builtins
import dis
import doctest
import pathlib
import re
import subprocess
import sys
import types

import numpy as np
import pytest

import figures
import sensorid
import sensorlab
from sensorlab.commands import main
from sensorlab.gap.kernels import arithmetic
from figures import fig1, identification, table

ROOT = pathlib.Path(sensorid.__file__).parent
SOURCE = pathlib.Path(sensorid.__file__).read_text()


def global_names(code, what):
    """Names outside itself that a compiled module or function does LOAD or STORE, all
    levels.
    """
    names = {i.argval for i in dis.get_instructions(code)
             if i.opname in (f"{what}_GLOBAL", f"{what}_NAME")}
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= global_names(constant, what)
    return names


BANNERS = [m.start() for m in re.finditer(r"^# ---- \d", SOURCE, re.M)]


@pytest.mark.parametrize("end", [*BANNERS[1:], len(SOURCE)])
def test_a_section_calls_only_sections_above_it(end):
    code = compile(SOURCE[:end], "part", "exec")
    known = (global_names(code, "STORE") | set(dir(builtins))
             | {"__name__", "__annotations__"})
    assert global_names(code, "LOAD") <= known


ROOMS = {    # of the laboratory; each takes only from those before it, and before its
             # folder
    "sensorlab/gap": ["costs", "effects", "members", "shapes", "processes", "values",
                      "steep", "integrated", "repeats", "interpolated", "resampled",
                      "dropouts", "catalogue", "own", "kernels", "lowpass", "draws",
                      "parts", "linear", "filters", "backward", "evidence", "changes",
                      "joint", "screens", "spectra", "signatures", "onsets", "scans",
                      "tuning", "codes", "clipping", "unaveraged", "averages",
                      "readings", "standins", "scales", "guesses", "account",
                      "implied", "directed", "rival", "wrong", "inside", "sought",
                      "weighing", "causes", "refits", "pairs", "probes", "places",
                      "distance", "closure", "drift", "twins", "flexible", "search",
                      "remainder", "verdict", "known", "diagnosis", "augmented",
                      "blackbox", "sizes", "words", "report", "curves"],
    "sensorlab/gap/kernels": ["lanes", "arithmetic", "whitening", "adjoint", "told",
                              "outliers", "levels", "steps", "mixtures"],
    "sensorlab/readers": ["dates", "clocks", "channels", "axes", "covariates",
                          "messages", "arrays", "text", "objects",
                          "matlab", "parquet", "rosbag", "px4", "ardupilot", "apart"],
    "sensorlab/drawings": ["style", "identification", "performance", "panels",
                           "diagnosis"],
    "sensorlab": ["printable", "tables", "gap", "rivals", "planning", "rest",
                  "readers", "units", "foreign", "modelschema", "modelfiles", "exports",
                  "drawings", "pages", "several", "commands"]}


def imported(file):
    """Modules of the project that a file imports, wherever in it."""
    tree = ast.parse(file.read_text())
    names = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import)
              for a in n.names]
    return [name for name in names if name.startswith("sensor")]


@pytest.mark.parametrize("folder", ROOMS)
def test_a_room_takes_only_from_those_before_it(folder):
    listed = ROOMS[folder]
    package = folder.replace("/", ".")
    elders = () if package == "sensorlab" else ROOMS["sensorlab"][:ROOMS[
        "sensorlab"].index(package.split(".")[1])]
    present = {f.stem for f in (ROOT / folder).iterdir() if f.name[0] not in "_."}
    assert present == set(listed)
    for number, room in enumerate(listed):
        here = ROOT / folder / room
        for file in here.glob("*.py") if here.is_dir() else [here.with_suffix(".py")]:
            for name in imported(file):
                inside = name.removeprefix(package + ".").split(".")[0]
                assert (name == "sensorid" or inside in listed[:number]
                        or name.split(".")[1] in elders
                        or here.is_dir() and inside == room
                        ), (file, name)


def test_the_paper_takes_nothing_from_the_laboratory_but_its_commands():
    # and, for those who ask by their old names, what moved there
    assert set(imported(ROOT / "sensorid.py")) == {
        "sensorlab.commands", "sensorlab", "sensorid"}
    assert sensorid.diagnose is sensorlab.diagnose
    with pytest.raises(AttributeError, match="are in the package sensorlab"):
        sensorid.nothing


def test_examples_in_the_docstrings_are_true():
    result = doctest.testmod(sensorid)
    assert result.attempted > 10 and result.failed == 0


def test_no_line_is_longer_than_88_columns():
    for file in [ROOT / "sensorid.py", *ROOT.glob("sensorlab/**/*.py"),
                 *ROOT.glob("figures/*.py"), *ROOT.glob("tests/*.py")]:
        long = [i for i, line in enumerate(file.read_text().splitlines(), 1)
                if len(line) > 88]
        assert not long, (file.name, long)


def test_no_name_of_a_module_is_given_twice():
    # the second would be that of what stands above it, too
    for file in [ROOT / "sensorid.py", *ROOT.glob("sensorlab/**/*.py"),
                 *ROOT.glob("figures/*.py")]:
        names = [name for node in ast.parse(file.read_text()).body for name in (
            [node.name] if isinstance(node, (ast.FunctionDef, ast.ClassDef)) else
            [n.id for target in getattr(node, "targets", ()) for n in ast.walk(target)
             if isinstance(n, ast.Name)])]
        assert len(names) == len(set(names)), file


def compiled():
    """Compiled functions of the project by name: (file, decorator, names called)."""
    found = {}
    for file in [ROOT / "sensorid.py", *ROOT.glob("sensorlab/**/*.py")]:
        for node in ast.parse(file.read_text()).body:
            how = [ast.unparse(d) for d in getattr(node, "decorator_list", ())]
            if any("njit" in one for one in how):
                found[node.name] = file, how[0], {
                    c.func.id for c in ast.walk(node) if isinstance(c, ast.Call)
                    and isinstance(c.func, ast.Name)}
    return found


def test_what_compiled_code_calls_is_compiled_inside_it():
    found = compiled()
    called = set.union(*(names for *_, names in found.values())) & found.keys()
    assert len(called) > 50
    for name in called:
        _, how, _ = found[name]
        assert "INSIDE" in how or "REORDERED" in how or "SUMS" in how, name
    for options in (sensorid.INSIDE, sensorid.REORDERED, arithmetic.SUMS):
        assert options["forceinline"]


@pytest.fixture
def small(monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "size", dict(trials=32, dt=1.0, progress=None))
    monkeypatch.setattr(figures, "OUTPUT", tmp_path)
    return tmp_path


@pytest.mark.large
def test_figures_draw_what_they_compute(small, capsys):
    from figures.__main__ import PAPER
    for name in PAPER.values():
        __import__(f"figures.{name}")
        getattr(figures, name).main()
    drawn = {f.name for f in small.iterdir()}
    expected = {f"fig{n}{panel}" for n in (1, 2, 3) for panel in "ab"} | {
        "fig4", "fig5", "fig6", "audit"}
    assert drawn == {f"{name}.{kind}" for name in expected for kind in ("png", "pdf")}
    text = capsys.readouterr().out
    for row in table.printed():
        assert row.statement in text


@pytest.mark.thorough
def test_figures_7_and_8_compare_the_algorithms(small, monkeypatch, capsys):
    from figures import fig7, fig8
    monkeypatch.setattr(figures, "DURATION", 1024.0)
    monkeypatch.setitem(figures.size, "trials", 16)
    fig7.main()
    fig8.main()
    assert {f.stem for f in small.iterdir() if f.is_file()} == {"fig7", "fig8"}
    assert capsys.readouterr().out.count("whittle") == 3 + 2 * 3 + 4


@pytest.mark.thorough
def test_one_record_of_every_hostile_condition(small):
    """All of them: python -m figures hostile"""
    from figures import hostile
    verdicts = {name: said[0] for name, said in hostile.compute().items()}
    wrong = {name: v for name, v in verdicts.items() if not hostile.right(name, v)}
    healthy = [name for name, (_, right) in hostile.CONDITIONS.items()
               if "none" in right]
    # a healthy record is named in 1 of 50, any other in one of eight, most of them
    # walks that grow and pulses: 20 and 14 conditions
    assert len(verdicts) == len(hostile.CONDITIONS) == 34 and len(healthy) == 20
    assert sum(name in wrong for name in healthy) <= 1 and len(wrong) <= 4, wrong


@pytest.mark.thorough
def test_what_is_outside_the_catalogue_has_no_wrong_name(small, monkeypatch):
    """One record of some kinds; all of them: python -m figures outside"""
    from figures import outside
    some = ("smooth bump", "level reached by a ramp", "sawtooth", "chirp", "echo",
            "square of a temperature", "noise garch", "noise even")
    monkeypatch.setattr(outside, "KINDS", {k: outside.KINDS[k] for k in some})
    said = outside.compute()
    answers = [outside.answer(kind, *verdicts) for kind, verdicts in said.items()]
    assert len(answers) == 8 and "wrong" not in answers and "none" not in answers, said
    assert outside.table(said).count("\n") == 8 + len(outside.ANSWERS) - 1


def test_allan_curves_cannot_tell_the_processes_apart_without_white_noise(small):
    """Sec. 4.1: only the +1/2 slope is seen in Figure 1b below 30 s."""
    for name, tau, _, expected in identification.allan_curves(fig1.EXAMPLES):
        early = (tau >= 4.0) & (tau <= 6.0)
        slope = np.polyfit(np.log(tau[early]), np.log(expected[early]), 1)[0]
        assert 0.4 < slope < 0.55, name


def test_rsd_of_scaled_priors_coincide(small):
    """Sec. 4.2: the RSD for tau_m in r [1, 5] min is the same at times r t, Figure
    4b."""
    short, long = (sensorid.criteria([figures.case(1, (60.0 * r, 300.0 * r))[1]],
                                     0.5 * r, 400.0 * r, 600, 7,
                                     times=[400.0 * r]).rsd[0]
                   for r in (1, 5))
    assert abs(short.calculated[0] - long.calculated[0]) < 1e-6


def test_help_of_the_figures_names_them_all():
    done = subprocess.run([sys.executable, "-m", "figures", "9"], cwd=ROOT, text=True,
                          capture_output=True)
    assert done.returncode == 2 and "no figure 9" in done.stderr


README = (ROOT / "README.md").read_text()


def test_the_readmes_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = "\n".join(re.findall(r"```python\n(.*?)```", README, re.S))
    exec(compile(example, "README", "exec"), {})


@pytest.mark.large
def test_the_readmes_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (model,) = re.findall(r"```json\n(.*?)```", README, re.S)
    pathlib.Path("model.json").write_text(model)
    commands = re.findall(r"^python -m sensorid (.*)$", README, re.M)
    assert {c.split()[0] for c in commands} == {
        "identify", "criteria", "simulate", "diagnose", "export", "plan"}
    for command in commands:
        command = command.replace("--trials 500", "--trials 20")
        few = ["--trials", "20"] if command.startswith("plan") else []
        assert main(command.split() + few) == 0
