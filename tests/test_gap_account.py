"""What stands for a posterior."""

import numpy as np

import sensorid
from sensorlab.gap import account, evidence


def test_where_a_posterior_is_bent_a_node_stands_for_it():
    def on_a_ring(theta):
        r = np.hypot(theta[:, 0] - 0.5, theta[:, 1] - 0.5)
        return -0.5 * ((r - 0.4) / 0.01)[:, None]**2
    p = tuple(sensorid.Parameter(s, 0.0, 1.0) for s in "ab")
    sample = evidence.integrate(on_a_ring, p)
    a, b = account.central(sample, on_a_ring)
    assert abs(np.hypot(a - 0.5, b - 0.5) - 0.4) < 0.02
