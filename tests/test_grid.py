import numpy as np
import pytest
from conftest import paper_case
from numpy.testing import assert_allclose

import sensorid as s


def test_gregory_weights_integrate_cubics_exactly():
    x = np.linspace(0, 1, 12)
    for power in range(4):
        total = s._gregory(12) @ x**power / 11
        assert_allclose(total, 1 / (power + 1), rtol=1e-12)


@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize("prior", ["uniform", "log"])
def test_prior_mass_is_one_whatever_the_box_and_the_scale(number, prior):
    for h in paper_case(number, prior=prior):
        g = s.grid(h, 0.1, 41)
        mass = np.exp(g.log_prior)
        if g.exponent.any():    # integrate scale**power d ln scale within the limits
            low = (g.limits[..., 0] - g.limits[..., 2]).max(1)
            high = (g.limits[..., 1] + g.limits[..., 2]).min(1)
            u = low[:, None] + (high - low)[:, None] * (np.arange(500) + 0.5) / 500
            weight = np.exp(g.power * u)
            ramp = np.vectorize(s._ramp.py_func)
            for begin, end, blur in np.moveaxis(g.limits[:, 1:], 0, 2):
                weight *= ramp((u - begin[:, None]) / blur[:, None])
                weight *= ramp((end[:, None] - u) / blur[:, None])
            mass = mass * weight.mean(1) * (high - low)
        assert_allclose(mass.sum(), 1.0, rtol=5e-3)


def test_scale_is_integrated_only_where_all_noises_are_free():
    free = [s._scale_parameter(h, 1.0) is not None
            for n in (1, 2, 3) for h in paper_case(n)]
    assert free == [True, True, False, False, True, True]

    def odd(dt, sigma_a):
        return s.shaping_filter([[0.5]], [[sigma_a**2]], [1.0], sigma_a)

    assert s._scale_parameter(s.hypothesis(odd, sigma_a=(0.1, 1.0)), 1.0) is None


def test_a_ramp_weighs_nodes_so_that_linear_functions_are_integrated():
    z = np.arange(-5.0, 60.0)
    for edge in (0.0, 0.3, 0.77):
        w = np.array([s._ramp.py_func(x) for x in z - edge])
        w *= np.array([s._ramp.py_func(x) for x in 40.6 - z])
        assert_allclose(w @ (2.0 + 3.0 * z),
                        2 * (40.6 - edge) + 1.5 * (40.6**2 - edge**2), rtol=1e-12)
