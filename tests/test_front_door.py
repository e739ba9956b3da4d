"""The front door: this file alone, the whole house, a wheel that is installed."""

import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest

import sensorid as s
import sensorlab
from sensorlab.commands import options
from sensorlab.gap import catalogue

ROOT = pathlib.Path(s.__file__).parent
WITHOUT = """
import runpy, sys
class Without:    # as if sensorlab were not installed
    def find_spec(name, *rest):
        if name == "sensorlab":
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without)
"""
ALONE = WITHOUT + """
sys.argv = ["sensorid.py", *sys.argv[1:]]
runpy.run_path("sensorid.py", run_name="__main__")
"""


@pytest.fixture
def record(tmp_path):
    """A folder with a copy of the module, with what has been compiled, and a record."""
    shutil.copy2(s.__file__, tmp_path)
    shutil.copytree(ROOT / "__pycache__", tmp_path / "__pycache__")
    y = s.simulate([s.hypothesis("random_walk", sigma_w=0.1)], 1.0, 300, 1).error[0]
    np.savetxt(tmp_path / "r.csv", np.column_stack([np.arange(300), y]), delimiter=",",
               header="time,error", comments="")
    return tmp_path


def alone(folder, *arguments):
    return subprocess.run([sys.executable, "-c", ALONE, *arguments], cwd=folder,
                          capture_output=True, text=True)


@pytest.mark.large
def test_the_module_alone_identifies_a_plain_csv(record):
    done = alone(record, "identify", "r.csv")
    assert done.returncode == 0, done.stderr
    assert "random_walk" in done.stdout and "decision at threshold" in done.stdout
    done = alone(record, "identify", "r.csv", "--column", "nope")
    assert done.returncode == 2 and "no column 'nope' among time, error" in done.stderr
    done = alone(record, "identify", "r.csv", "--dt", "0.5")
    assert done.returncode == 2 and "1 s apart, --dt is 0.5 s" in done.stderr
    (record / "r.npz").write_bytes(b"PK\xa9\xff")
    done = alone(record, "identify", "r.npz")
    assert done.returncode == 2 and "r.npz: no text: a CSV" in done.stderr
    done = alone(record, "identify", "none.csv")
    assert done.returncode == 2 and "none.csv: No such file" in done.stderr


@pytest.mark.parametrize("line", ["criteria m.json --duration 5", "diagnose r.csv",
                                  "identify r.csv --plot p.png", "identify"])
def test_the_module_alone_says_what_the_rest_needs(record, line):
    done = alone(record, *line.split())
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "copy the folder sensorlab beside it, or install" in done.stderr


def test_the_module_alone_is_the_whole_python_interface_of_the_paper(record):
    code = WITHOUT + """
import sensorid as s
assert set(s.__all__) <= set(dir(s)), set(s.__all__) - set(dir(s))
h = [s.hypothesis("white_noise", sigma_v=(0.5, 2.0)),
     s.hypothesis("random_walk", sigma_w=(0.1, 1.0))]
y = s.simulate(h[:1], 1.0, 300, seed=1).error[0]
answer = s.identify(y, 1.0, h)
print(s.decide(answer), s.criteria(h, 1.0, 50.0, 16, checkpoint="kept").trials,
      s.identify(y, 1.0).best.hypothesis.name)
print(s.allan_misfit(y, 1.0, answer.best).sentence)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=record, text=True,
                          capture_output=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0 16 white_noise\nAllan deviation of the record")


@pytest.mark.parametrize("code", [
    "import runpy; runpy.run_module('sensorid', run_name='__main__')",
    "from sensorlab.commands import main; main()"])
def test_help_imports_nothing_large(code):
    code = ("import sys; sys.argv = ['sensorid', 'identify', '--help']\n"
            f"try:\n    {code}\n"
            "except SystemExit:\n    print([m for m in ('numba', 'numpy', 'scipy') "
            "if m in sys.modules])\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stdout + done.stderr


def test_the_help_names_what_there_is():
    assert options.MODELS == tuple(s.MODELS)
    assert options.EFFECTS == tuple(catalogue.CATALOGUE)
    assert options.ALGORITHMS == tuple(sensorlab.ALGORITHMS)


def test_what_is_public_is_there_and_little():
    for module, most in ((s, 26), (sensorlab, 25)):
        assert len(module.__all__) <= most
        for name in module.__all__:
            assert getattr(module, name) is not None, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        sensorlab.nothing


def test_results_are_shown_in_a_few_lines():
    h = [s.hypothesis("white_noise", sigma_v=(0.5, 2.0)),
         s.hypothesis("random_walk", sigma_w=(0.1, 1.0))]
    trials = s.simulate(h, 1.0, 300, 3, seed=1)
    y = trials.error[0]
    answer = s.identify(y, 1.0, h)
    c = s.criteria(h, 1.0, 50.0, 16)
    d = sensorlab.diagnose(y, 1.0, h, effects=[catalogue.CATALOGUE["rate_ramp"]])
    for result in (trials, answer, answer.best, s.grid(h[0], 1.0, 9), c,
                   c.error_probability, s.bank(h[0], 1.0, [[1.0]]), d, d.after, d.final,
                   d.final.sample, d.scene):
        assert len(repr(result)) < 1600, repr(result)


@pytest.mark.large
def test_a_wheel_that_is_installed_elsewhere_works(record):
    source, site = record / "source", record / "site"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(
        ".*", "__pycache__", "build", "*.egg-info", "tests", "data", "output"))
    pip = [sys.executable, "-m", "pip", "-q"]
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w",
                    str(record / "wheels"), str(source)], check=True)
    (wheel,) = (record / "wheels").glob("sensorid-*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(wheel)],
                   check=True)
    assert not (site / "figures").exists() and not (site / "tests").exists()
    (record / "sensorid.py").unlink()
    code = (f"import sys; sys.path.insert(0, {str(site)!r})\n"
            "import sensorid; from sensorlab.commands import main\n"
            f"assert sensorid.__file__.startswith({str(site)!r})\n"
            "sys.exit(main(['identify', 'r.csv', '--json', 'o.json']))\n")
    done = subprocess.run([sys.executable, "-c", code], cwd=record, text=True,
                          capture_output=True)
    assert done.returncode == 0, done.stderr
    assert (record / "o.json").exists()
