"""Effects that are seen in the values themselves."""

from conftest import DT
import numpy as np
import pytest

from sensorlab import Scene
from sensorlab.gap import readings


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
