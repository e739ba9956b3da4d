"""What stands for a posterior."""

import numpy as np
import pytest

import sensorid
from sensorlab.gap import account, evidence, guesses
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.effects import Found, Scene
from sensorlab.gap.members import Member


def test_where_a_posterior_is_bent_a_node_stands_for_it():
    def on_a_ring(theta):
        r = np.hypot(theta[:, 0] - 0.5, theta[:, 1] - 0.5)
        return -0.5 * ((r - 0.4) / 0.01)[:, None]**2
    p = tuple(sensorid.Parameter(s, 0.0, 1.0) for s in "ab")
    sample = evidence.integrate(on_a_ring, p)
    a, b = account.central(sample, on_a_ring)
    assert abs(np.hypot(a - 0.5, b - 0.5) - 0.4) < 0.02


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("odd", [0.02, 1.0])    # of the time
def test_where_most_samples_are_in_bursts_their_spectrum_tells_of_a_process(odd):
    rng = np.random.default_rng(3)
    y = rng.standard_normal(2000) * np.where(rng.random(2000) < odd, 3.0, 0.3)
    scene = Scene(y, 0.1, {})
    white = sensorid.hypothesis("white_noise", sigma_v=(0.1, 1.0))
    bursts = Member(white, scene, (Found(CATALOGUE["noise_bursts"], values=dict(
        quiet=sensorid.Parameter("quiet", 0.1, 5.0),
        duration=sensorid.Parameter("duration", 0.1, 5.0),
        sigma=sensorid.Parameter("sigma", 2.9, 3.1))),))
    past = account.account(scene, (bursts,))
    richer = bursts.with_effect(CATALOGUE["correlated_noise"])
    told = guesses.guesses_from(past, 0, richer, scene, ())
    assert len(told) == 2 and all(np.isfinite(mean).all() for mean, _ in told)


def test_outliers_of_a_size_that_is_known_have_a_guess_of_their_rate():
    rng = np.random.default_rng(4)
    y = rng.standard_normal(2000) + 20.0 * (rng.random(2000) < 0.01)
    scene = Scene(y, 0.1, {})
    h = Member(sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0)), scene)
    past = account.account(scene, (h,))
    richer = h.joined(Found(CATALOGUE["outliers"], values=dict(
        rate=sensorid.Parameter("rate", 1e-4, 0.1, True),
        sigma=sensorid.Parameter("sigma", 20.0, 20.0))))
    new = account.account(scene, (h,), [richer], past=past)
    assert new.log_evidence > past.log_evidence + 100.0
    assert new.theta[1] == pytest.approx(0.01, rel=0.5)
