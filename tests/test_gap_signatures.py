"""Signatures against least squares and quadrature."""

from conftest import DT, MODEL, dense
import numpy as np
from numpy.testing import assert_allclose
from scipy import integrate as quadrature
from scipy.stats import norm

import sensorid
import sensorlab
from sensorlab import Scene
from sensorlab.gap import filters, signatures


def test_gain_of_a_sinusoid_is_that_of_least_squares():
    y = sensorid.simulate(MODEL[1:], DT, 400, seed=4).error[0]
    scene, theta = Scene(y, DT, {}), np.array([[300.0, 0.9, 0.4]])
    solved = filters.solve(MODEL[1], scene, (), theta)
    found = signatures._scan_frequencies(MODEL[1], solved, scene, theta)
    inverse = np.linalg.inv(dense(theta[0], 400))
    for i in (10, 50, 300):    # the information is that of a long record: to 2 %
        phase = 2 * np.pi * found.psi[i] * scene.time
        s = np.column_stack([np.cos(phase), np.sin(phase)])
        b = s.T @ inverse @ y
        assert_allclose(found.gain[0, i], b @ np.linalg.solve(s.T @ inverse @ s, b),
                        rtol=0.04)


def test_bayes_factor_of_a_size_is_the_integral_over_it():
    z, k = 3.0, np.arange(1, len(signatures.SIZES) + 1)
    by_hand = np.average([quadrature.quad(
        lambda a: a * a / v * norm.pdf(a, scale=v**0.5) * np.exp(a * z - 0.5 * a * a),
        -40.0, 40.0, points=[0.0, z])[0] for v in signatures.SIZES],
        weights=1.0 / (k * (k + 1.0)))
    gain = np.array([[z * z]])
    result = signatures._mean_bayes(gain, signatures._TABLE[1],
                                    1.0 / signatures._ROOT[1])
    assert_allclose(result, np.log(by_hand), rtol=1e-3)


def test_moments_of_a_size_are_integrals_over_its_posterior():
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=0.0)
    scene = Scene(np.random.default_rng(5).standard_normal(400), DT, {})
    scene = scene._replace(y=scene.y + 7e-4 * scene.time)
    search = signatures.searches(scene, [sensorlab.CATALOGUE["rate_ramp"]])
    sample = signatures.signature_evidence(h, scene, (), search)
    _, parameters = signatures.estimate_signature([h], scene, (), search[0], [sample],
                                                  1)
    information = scene.time @ scene.time
    z = scene.time @ scene.y / np.sqrt(information)
    k = np.arange(1, len(signatures.SIZES) + 1)

    def moment(power):    # of the size in standard errors
        return np.average([quadrature.quad(
            lambda a: a**power * a * a / v * norm.pdf(a, scale=v**0.5)
            * np.exp(a * z - 0.5 * a * a), -40.0, 40.0, points=[0.0, z])[0]
            for v in signatures.SIZES], weights=1.0 / (k * (k + 1.0)))
    mean = moment(1) / moment(0)
    sd = np.sqrt(moment(2) / moment(0) - mean**2)
    assert_allclose(np.array(parameters["slope"]) * np.sqrt(information), [mean, sd],
                    rtol=1e-6)
