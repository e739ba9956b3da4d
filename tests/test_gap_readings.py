"""Effects that are seen in the values themselves."""

from conftest import DT
import numpy as np
import pytest

from sensorlab import Scene
from sensorlab.gap import catalogue, readings


def test_readings_are_seen_and_what_is_none_is_not():
    rng = np.random.default_rng(9)
    y = np.cumsum(0.05 * rng.standard_normal(3000)) + 0.5 * rng.standard_normal(3000)
    for clean in (y, np.round(y, 4), y.astype(np.float32).astype(float)):
        assert readings.readings(Scene(clean, DT, {})) == ()
    lattice = 0.3 * np.round(y / 0.3) + 0.1
    (one,) = readings.readings(Scene(lattice, DT, {}))
    assert one.found.name == "quantization"
    assert one.found.values["lsb"] == pytest.approx(0.3)
    (one,) = readings.readings(Scene(np.clip(y, -1.0, 1.2), DT, {}))
    assert one.found.name == "saturation" and one.found.values["limits"] == [-1.0, 1.2]
    stuck = y.copy()
    stuck[700:730] = stuck[700]
    (one,) = readings.readings(Scene(stuck, DT, {}))
    assert one.found.name == "stuck" and one.found.values["spans"] == [[700.0, 30]]
    held = lattice.copy()
    held[700:760] = held[700]
    assert [r.found.name for r in readings.readings(Scene(held, DT, {}))] == [
        "stuck", "quantization"]


@pytest.mark.parametrize("lsb, printed", [(0.061, 0.01), (0.0152, 1e-7), (0.25, 1e-3)])
def test_a_lattice_is_seen_through_the_digits_that_were_printed(lsb, printed):
    y = np.random.default_rng(3).standard_normal(4000)
    y = printed * np.round(lsb * np.round(y / lsb) / printed)
    assert catalogue.lattice(y) == pytest.approx(lsb, rel=0.01)
    scene = Scene(catalogue.snapped(y), DT, {})
    assert len(np.unique(scene.y)) <= 1 + np.ptp(y) / (0.99 * lsb)
    assert "stuck" not in [r.found.name for r in readings.readings(scene)]


def test_digits_and_two_levels_far_apart_are_no_lattice():
    rng = np.random.default_rng(4)
    y = rng.standard_normal(4000)
    assert catalogue.lattice(y) == 0.0
    assert catalogue.lattice([float(f"{v:.6g}") for v in y] * np.ones(4000)) == 0.0
    poses = np.where(np.arange(4000) < 2000, 9.8, -9.8) + 0.01 * y
    assert catalogue.lattice(poses) == 0.0
    assert catalogue.lattice(np.round(y, 4)) == pytest.approx(1e-4)
