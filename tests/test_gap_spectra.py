"""What a process would gain by its spectrum, against sums over frequencies and filters.
"""

import numpy as np
from conftest import DT, WHITE, WHITE_OF_A_RANGE, member, white_with
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.special import logsumexp, ndtr

from sensorid import at_quantiles
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import account, evidence, filters, spectra
from sensorlab.gap.effects import fixed


def with_band(n=600, **values):
    """Scene of white noise with a band; its hypothesis without and with one."""
    band = Found(CATALOGUE["narrow_band_noise"], values=fixed(**values))
    scene = Scene(white_with(band, samples=n, seed=3), DT, {})
    (h,) = WHITE_OF_A_RANGE
    return scene, member(scene, h), member(scene, h, "narrow_band_noise")


def promised(h, richer, scene, theta):
    """A further process of a hypothesis h that is likeliest at theta, promised."""
    seen = spectra.residual_spectrum(h, scene, (), theta)
    return spectra.promise(richer, scene, seen, theta)


VARIANCE = np.array([0.02, 0.7])    # of bands


def spectrum_and_gains(F, tau, density):
    """A spectrum with a band, and Whittle's gain of one about each of its F
    frequencies, sum by sum.
    """
    frequency = np.arange(1, F + 1) / (2.0 * F + 2.0)
    a, expected = np.exp(-1.0 / tau), []

    def shape(middle):
        away = 2.0 * np.pi * (frequency - middle)
        return 0.5 * (1.0 - a * a) / np.abs(1.0 - a * np.exp(1j * away))**2
    power = np.random.default_rng(1).exponential(1.0 + 0.4 * shape(0.2) / density)
    seen = spectra.Spectrum(frequency, power / power.mean(), density, np.ones(F))
    for middle in frequency:
        gain = []
        for v in VARIANCE:
            ratio = 1.0 + v * shape(middle) / density
            gain.append(-F * np.log(np.mean(seen.power / ratio)) - np.log(ratio).sum())
        expected.append(logsumexp(gain) - np.log(2))
    return seen, np.array(expected)


def test_gains_of_bands_are_whittles():
    seen, expected = spectrum_and_gains(119, 3.0, np.random.default_rng(2).uniform(
        0.5, 2.0, 119))
    tried = slice(None, None, 4)    # middles; between them it is interpolated
    assert_allclose(spectra._band_gains(seen, 1.0, 3.0, VARIANCE)[tried],
                    expected[tried], rtol=1e-9, atol=1e-9)


def test_gains_of_wide_bands_need_no_fine_spectrum(monkeypatch):
    seen, expected = spectrum_and_gains(1199, 3.0, np.linspace(2.0, 0.5, 1199))
    coarse = spectra._band_gains(seen, 1.0, 3.0, VARIANCE)
    monkeypatch.setattr(spectra, "PARTS", 10**9)
    fine = spectra._band_gains(seen, 1.0, 3.0, VARIANCE)
    # by interpolation between middles, and by what lies beyond the reach of a band
    off = np.abs(fine - expected).max()
    assert 0.0 < np.abs(coarse - fine).max() < off < 0.15 * expected.max()


def test_frequencies_are_drawn_from_their_law():
    sought = spectra.Sought("frequency", 0.1, 0.5, np.array([1.0, 6.0, 2.0, 1.0]))
    f = sought.quantile((np.arange(10000) + 0.5) / 10000)
    assert_allclose(np.histogram(f, 4, (0.1, 0.5))[0] / 10000, sought.mass / 10.0,
                    atol=1e-3)
    weight = np.exp(sought.log_ratio(f))    # of the prior
    assert_allclose([weight.mean(), weight @ f / 10000], [1.0, sought.mean], rtol=1e-3)
    assert_allclose(np.sqrt(weight @ (f - sought.mean)**2 / 10000), sought.sd,
                    rtol=1e-3)


def test_evidence_of_an_unknown_band_is_the_sum_over_all_frequencies():
    scene, h, richer = with_band(frequency=0.21, tau=40.0, sigma=0.5)
    richer, _ = promised(h, richer, scene, np.array([1.0]))
    known = {("narrow_band_noise", "tau"): 40.0, ("narrow_band_noise", "sigma"): 0.5}
    richer = richer.fixed(known)._replace(hypothesis=WHITE[0])
    sought = richer.parameters[1]
    every = sought.low + (sought.high - sought.low) * (np.arange(3000) + 0.5) / 3000
    nodes = np.column_stack([np.ones(3000), every, np.full(3000, 40.0),
                             np.full(3000, 0.5)])
    exact = logsumexp(filters.log_likelihoods(richer, scene, (), nodes)) - np.log(3000)
    s = evidence.integrate(
        lambda theta: filters.log_likelihoods(richer, scene, (), theta)[:, None],
        richer.parameters)
    assert abs(s.log_evidence[0] - exact) < 0.15
    assert abs(s.mean[1] - 0.21) < 4.0 * s.sd()[1] < 0.02


def test_a_promise_is_about_what_a_filter_finds():
    scene, h, band = with_band(frequency=0.21, tau=20.0, sigma=0.6)
    base = account.account(scene, [h])
    theta = base.samples[0].theta[base.samples[0].log_likelihood.argmax()]
    for name, apart in (("narrow_band_noise", 4.0), ("blue_noise", 2.0)):
        richer = member(scene, *WHITE_OF_A_RANGE, name)
        richer, told = promised(h, richer, scene, theta)
        found = account.account(scene, [h], [richer])
        gain = found.log_evidence - base.log_evidence
        assert abs(told - gain) < apart, name
        assert (gain > 15.0) == (name == "narrow_band_noise")


def test_a_band_at_an_end_of_its_range_and_short_records_are_no_errors():
    for n in (64, 65):
        scene, h, richer = with_band(n, frequency=0.45, tau=4.0, sigma=0.2)
        _, told = promised(h, richer, scene, np.array([1.0]))
        assert np.isfinite(told)


def test_a_band_that_has_all_of_the_power_has_a_finite_gain():
    frequency, power = np.arange(1.0, 400.0) / 800.0, np.zeros(399)
    power[200] = 399.0
    seen = spectra.Spectrum(frequency, power, np.full(399, 1e-20), np.ones(399))
    gain = spectra._band_gains(seen, 1.0, 400.0, np.array([1.0]))
    assert np.isfinite(gain).all() and gain.max() > 1e4
    assert_allclose(gain[200], gain.max())


def test_a_law_is_where_whittles_likelihood_is_largest():
    noise = Found(CATALOGUE["correlated_noise"], values=fixed(tau=12.0, sigma=0.7))
    scene = Scene(white_with(noise, samples=2000, seed=5), DT, {})
    (h,) = WHITE_OF_A_RANGE
    h, richer = member(scene, h), member(scene, h, "correlated_noise")
    mean, covariance = spectra.posterior_law(
        richer, scene, (), h, scene.y.std()[None], {("", "sigma_v"): 0.0})
    y, f = scene.y - scene.y.mean(), np.fft.rfftfreq(2000)[1:-1]
    power = np.abs(np.fft.rfft(y)[1:-1])**2 / 2000

    def log_spectrum(x):
        (sigma_v, tau, sigma), = at_quantiles(richer.parameters, ndtr(x)[None])
        a = np.exp(-1.0 / tau)
        return np.log(sigma_v**2 + sigma**2 * (1.0 - a * a) / np.abs(
            1.0 - a * np.exp(-2j * np.pi * f))**2)

    def cost(x):
        log_s = log_spectrum(x)
        return np.sum(power * np.exp(-log_s) + log_s) + 0.5 * x @ x
    best = min((minimize(cost, x0, method="Nelder-Mead", options=dict(
        xatol=1e-5, fatol=1e-8, maxiter=4000)) for x0 in (
            np.zeros(3), np.array([0.0, -1.0, 0.5]))), key=lambda one: one.fun).x
    g = np.array([(log_spectrum(best + step) - log_spectrum(best - step)) / 2e-4
                  for step in 1e-4 * np.eye(3)])
    expected = np.linalg.inv(np.eye(3) + g @ g.T)
    sd = np.sqrt(np.diag(expected))
    # it knows the spectrum by bins, and the edges of a record otherwise
    assert_allclose((mean - best) / sd, 0.0, atol=0.1)
    assert_allclose(covariance / np.outer(sd, sd), expected / np.outer(sd, sd),
                    atol=0.05)
