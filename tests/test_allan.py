"""The Allan variance against its definition, allantools and published curves."""

import allantools
import numpy as np
import pytest
from numpy.testing import assert_allclose

import naive
import sensorid as s


def test_allan_variance_equals_the_definition():
    omega = np.random.default_rng(1).normal(size=200)
    m = [1, 2, 7, 100]
    expected = [naive.allan_variance(omega, k) for k in m]
    assert_allclose(s.allan_variance(omega, 0.3, m), expected, rtol=1e-10)
    assert s.allan_variance([omega, omega], 0.3, 7).tolist() == 2 * [
        s.allan_variance(omega, 0.3, 7)]


def test_allan_deviation_equals_allantools():
    omega = np.random.default_rng(2).normal(size=5000).cumsum() + 1e3
    tau, adev = s.allan_deviation(omega, 0.01, per_octave=3)
    taus, expected, _, _ = allantools.oadev(omega, rate=100.0, data_type="freq",
                                            taus=tau)
    assert_allclose(taus, tau, rtol=1e-9)
    assert_allclose(adev, expected, rtol=1e-8)


def test_allan_deviation_gives_the_published_curve_of_adis16405(real):
    run = np.load(real / "adis16405_run1.npz")
    published = np.load(real / "smac_allan_curves.npz")
    for row, name in enumerate(("gyro", "gyro", "gyro", "accel", "accel", "accel")):
        y = run[f"{name}_counts"][row % 3] * float(run[f"{name}_lsb"])
        ours = np.sqrt([s.allan_variance(y, 0.01, 2**k) for k in range(1, 11)])
        assert_allclose(ours, published["adis_adev"][row, :10], rtol=1e-4)


@pytest.mark.parametrize("name, parameters", [
    ("random_walk", dict(sigma_w=0.1, sigma_v=0.5)),
    ("markov", dict(tau_m=20.0, sigma_m=1.0, sigma_v=0.3)),
    ("two_markov", dict(tau_m=20.0, sigma_m=1.0, tau_n=3.0, sigma_n=0.5))])
def test_expected_allan_variance_is_the_mean_over_simulated_records(name, parameters):
    h = s.hypothesis(name, **parameters)
    y = s.simulate([h], 1.0, 20, 4000, seed=3).error
    for m in (1, 4, 10):
        first = [s.allan_variance(row[:2 * m], 1.0, m) for row in y]
        expected = s.model_allan_variance(h.model(1.0, **parameters), m)
        assert abs(np.mean(first) - expected) < 4 * np.std(first) / np.sqrt(len(first))


def test_expected_allan_variance_of_a_ramp_has_its_closed_form():
    filt = s.rate_ramp(0.5, slope=3.0)
    assert_allclose(s.model_allan_variance(filt, 8), (3.0 * 4.0)**2 / 2, rtol=1e-12)


def test_missing_samples_leave_out_their_pairs_of_clusters():
    omega = np.random.default_rng(4).normal(size=300)
    omega[100:120] = np.nan
    parts = omega[:100], omega[120:]
    pairs = [len(part) - 2 * 5 + 1 for part in parts]
    expected = np.average([naive.allan_variance(part, 5) for part in parts],
                          weights=pairs)
    assert_allclose(s.allan_variance(omega, 1.0, 5), expected, rtol=1e-9)
    assert np.isnan(s.allan_variance(np.where(np.arange(9) % 2, np.nan, 1.0), 1.0, 2))


@pytest.mark.large
def test_one_gap_hides_no_misfit():
    h = s.hypothesis("white_noise", sigma_v=(0.3, 3.0))
    truth = s.hypothesis("random_walk", sigma_w=0.02, sigma_v=1.0)
    sds = np.empty((10, 2))
    for y, own in zip(s.simulate([truth], 1.0, 4000, 10, seed=5).error, sds):
        gap = y.copy()
        gap[1500:2500] = np.nan
        own[:] = [abs(s.allan_misfit(one, 1.0, s.identify(one, 1.0, h).best).sd)
                  for one in (y, gap)]
    whole, less = np.median(sds, axis=0)
    assert 0.6 < less / whole < 1.1    # three of four samples are left


def test_a_record_too_short_is_refused():
    with pytest.raises(ValueError, match="m = 6 does not fit a record of 11 samples"):
        s.allan_variance(np.arange(11.0), 1.0, 6)


@pytest.mark.parametrize("call, message", [
    (lambda: s.allan_variance(np.arange(11.0), 1.0, 1.5), "m is 1.5: whole numbers"),
    (lambda: s.allan_variance(np.arange(11.0), -1.0, 1), "sampling interval is -1.0 s"),
    (lambda: s.allan_deviation(np.arange(11.0), 1.0, per_octave=0), "1 or more"),
    (lambda: s.allan_deviation(np.ones((3, 40)), 1.0), "one axis of one sensor"),
    (lambda: s.allan_deviation([], 1.0), "two samples or more"),
    (lambda: s.model_allan_variance(s.white_noise(1.0, 2.0), 0), "m is 0: whole")])
def test_averaging_times_are_whole_samples(call, message):
    with pytest.raises(ValueError, match=message):
        call()
