import pathlib

import pytest
from numpy.testing import assert_array_equal

import sensorid

REAL = pathlib.Path(__file__).parent.parent.parent / "shared" / "data" / "real"


@pytest.fixture(scope="session")
def real():
    """Folder of the real recordings, which are not part of the project."""
    if not REAL.is_dir():
        pytest.skip("the real recordings are not beside this checkout")
    return REAL


def paper_case(number, **change):
    """The two hypotheses of Sec. 4 in case 1, 2 or 3."""
    white = {1: {}, 2: {"sigma_v": 0.5}, 3: {"sigma_v": (0.25, 1.0)}}[number]
    return (
        sensorid.hypothesis("random_walk", sigma_w=(0.04, 0.15), **white, **change),
        sensorid.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5), **white,
                            **change))


def same(a, b):
    """Two `Criteria` are the same to the last bit."""
    for x, y in zip((a.error_probability, *a.rsd), (b.error_probability, *b.rsd)):
        for part in x._fields:
            assert_array_equal(getattr(x, part), getattr(y, part))


RATES = {}    # filled by bench_bank.py


def pytest_terminal_summary(terminalreporter):
    """The table of the benchmark."""
    if not RATES:
        return
    terminalreporter.section("filter updates a second, or seconds")
    best = max((r for name, r in RATES.items() if name.startswith("ours")), default=0)
    for name, rate in RATES.items():
        seconds = name.endswith(", s")
        ratio = "" if seconds or not best else f"{rate / best:10.2g} of ours"
        terminalreporter.write_line(f"{name:<52}{rate:10.3g}{ratio}")
