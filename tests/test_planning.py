"""The same sensor under other conditions."""

import pytest
from conftest import paper_case

import sensorid as s
from sensorlab.planning import at_condition


def test_the_same_sensor_at_another_rate_has_the_same_densities():
    H, dt = at_condition(paper_case(3), 1.0, 0.25, 0.5)
    walk, process = H
    assert dt == 0.25
    assert walk.parameters[0][1:3] == (0.02, 0.075)
    assert walk.parameters[1][1:3] == (1.0, 1.0)
    assert process.parameters[0][1:3] == (60.0, 1500.0)
    quiet, _ = at_condition([s.hypothesis("random_walk", sigma_w=1.0)], 1.0,
                              sigma_v=2.0)
    assert quiet[0].parameters[-1][:3] == ("sigma_v", 2.0, 2.0)
    deaf = s.hypothesis(lambda dt, sigma_w: s.random_walk(dt, sigma_w), "mine",
                        sigma_w=(0.1, 1.0))
    with pytest.raises(ValueError, match="mine takes no sigma_v"):
        at_condition([deaf], 1.0, None, 2.0)
