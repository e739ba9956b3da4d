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

    def at_least(dt, sigma_v, lsb):
        return s.shaping_filter([[1]], [[0.1 * sigma_v]], [1], max(sigma_v, lsb))

    def bent(dt, sigma_v):
        return s.shaping_filter([[1]], [[0]], [1], sigma_v * (1 + 2 * (sigma_v > 0.6)))
    for model, more in ((odd, {}), (bent, {}), (at_least, dict(lsb=(0.0, 1.0)))):
        symbol = "sigma_a" if model is odd else "sigma_v"
        h = s.hypothesis(model, **{symbol: (0.1, 1.0)}, **more)
        assert s._scale_parameter(h, 1.0) is None


def test_what_is_not_linear_in_its_noise_has_the_posterior_of_a_plain_grid():
    def at_least(dt, sigma_v, lsb):
        return s.shaping_filter([[1]], [[0.1 * sigma_v]], [1], max(sigma_v, lsb))
    h = s.hypothesis(at_least, sigma_v=(0.1, 1.0), lsb=(0.0, 1.0))
    y = s.simulate([h], 0.1, 200, seed=0).error[0]
    _, mean, _ = next(s.posteriors(s.uniform_grid(h, 0.1, 81), y[None], [200]))
    assert_allclose(s.identify(y, 0.1, [h]).estimates[0].mean, mean[0], atol=0.02)


def test_a_ramp_weighs_nodes_so_that_linear_functions_are_integrated():
    z = np.arange(-5.0, 60.0)
    for edge in (0.0, 0.3, 0.77):
        w = np.array([s._ramp.py_func(x) for x in z - edge])
        w *= np.array([s._ramp.py_func(x) for x in 40.6 - z])
        assert_allclose(w @ (2.0 + 3.0 * z),
                        2 * (40.6 - edge) + 1.5 * (40.6**2 - edge**2), rtol=1e-12)


@pytest.mark.parametrize("make", [s.grid, s.uniform_grid])
@pytest.mark.parametrize("dt, nodes, message", [
    (1.0, 0, "numbers of nodes 0: whole numbers >= 1"), (1.0, [9, -3], ">= 1"),
    (1.0, 2.5, "whole numbers"), (1.0, [5, 5, 5, 5], "nodes along 4 axes"),
    (0.0, 5, "the sampling interval is 0.0 s")])
def test_what_is_no_grid_is_refused(make, dt, nodes, message):
    h = s.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5),
                     sigma_v=(0.25, 1.0))
    with pytest.raises(ValueError, match=message):
        make(h, dt, nodes)


@pytest.mark.parametrize("y, stops, message", [
    (np.ones(50), [50], r"records of shape \(50,\): \(C, N\) is needed"),
    (np.ones((1, 50)), [10.5], "stops .* whole numbers"),
    (np.full((1, 50), 1j), [50], "no real number"),
    ([["a"] * 50], [50], "no real number")])
def test_what_is_no_record_of_a_grid_is_refused(y, stops, message):
    g = s.grid(s.hypothesis("random_walk", sigma_w=(0.1, 1.0)), 1.0, 5)
    with pytest.raises(ValueError, match=message):
        next(s.posteriors(g, y, stops))
