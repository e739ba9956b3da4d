import pathlib

import pytest

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
