"""What pictures of a diagnosis show."""

import doctest

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import sensorid
import sensorlab
from conftest import DT
from sensorlab.gap import curves


def test_examples_in_the_docstrings_are_true():
    result = doctest.testmod(curves)
    assert result.attempted and result.failed == 0


def test_the_spectrum_holds_the_variance():
    rng = np.random.default_rng(0)
    y = rng.standard_normal((3, 4096)) + 2.0 * np.sin(np.arange(4096))
    frequency, density = curves.noise_density(y, 0.02)
    width = 0.5 / 0.02 * np.diff(np.unique(np.round(np.geomspace(
        1, 2049, curves.BANDS + 1)).astype(int))) / 2048
    # the window weighs the white noise unevenly: 2 % of 4096 chi2 of one degree
    assert_allclose(density**2 @ width, y.var(1), rtol=0.05)
    line = frequency[density[0].argmax()]
    assert line == pytest.approx(1.0 / (2.0 * np.pi * 0.02), rel=0.1)


def test_missing_samples_leave_the_noise_density_where_it_is():
    y = np.random.default_rng(1).standard_normal((2, 8000))
    y[:, ::3] = np.nan
    _, density = curves.noise_density(y, 0.1)
    assert density[:, -20:].mean() == pytest.approx(np.sqrt(0.2), rel=0.05)


@pytest.mark.parametrize("a, q, p0", [(1.0, 0.04, 0.0), (0.9, 0.19, 1.0),
                                      (0.5, 0.3, 2.0)])
def test_a_process_has_the_covariance_of_its_definition(a, q, p0):
    n = 30
    P = [a * a * p0 + q]
    while len(P) < n:
        P.append(a * a * P[-1] + q)
    C = np.array([[a**abs(i - j) * P[min(i, j)] for j in range(n)] for i in range(n)])
    w = np.random.default_rng(2).standard_normal(n)
    assert_allclose(curves._times_covariance(w, a, q, p0), C @ w, rtol=1e-10)


def test_a_long_curve_keeps_its_extremes_and_its_gaps():
    x = np.arange(10000.0)
    y = np.sin(x / 300.0)
    y[1234], y[7000:8000] = 40.0, np.nan
    few_x, few_y = curves.envelope(x, y, 500)
    assert len(few_y) == 1000 and np.nanmax(few_y) == 40.0
    assert few_x[np.nanargmax(few_y)] == pytest.approx(1234, abs=20)
    assert np.isnan(few_y[(few_x > 7020) & (few_x < 7980)]).all()
    assert_array_equal(curves.envelope(x[:900], y[:900], 500)[1], y[:900])


def test_means_pass_over_what_is_missing():
    y = np.array([1.0, np.nan, 3.0, 5.0, np.nan, np.nan, 7.0])
    x, means = curves.block_means(np.arange(7.0), y, 2)
    assert_array_equal(x, [0.5, 2.5, 4.5])
    assert_array_equal(means, [1.0, 4.0, np.nan])


def test_an_added_variable_has_the_slope_of_least_squares(answers):
    d, record = answers["bias_step"]
    (added,) = curves.view(d).added
    # white noise of sigma 1 and an unknown level: plain least squares
    onset = d.found[0].values["onset"][0]
    s = (DT * np.arange(len(record.error)) >= onset - 0.5).astype(float)
    s -= s.mean()
    size, sd = s @ record.error / (s @ s), (s @ s)**-0.5
    drawn = d.final.signatures[0].found.values["size"]
    assert added.slope == pytest.approx(1.0, abs=0.01)
    assert added.sd == pytest.approx(sd / size, rel=0.05)
    assert drawn == pytest.approx(size, rel=0.1)
    expected, seen, error = added.means
    assert len(expected) <= curves.BINS and np.all(np.diff(expected) > 0.0)
    assert np.mean(np.abs(seen - expected) < 2.5 * error) > 0.8


def test_a_slow_process_is_drawn_where_it_is():
    rng = np.random.default_rng(3)
    m = np.empty(1500)
    m[0] = 2.0 * rng.standard_normal()
    for i in range(1, 1500):
        m[i] = 0.99 * m[i - 1] + 2.0 * np.sqrt(1.0 - 0.99**2) * rng.standard_normal()
    d = sensorlab.diagnose(m + rng.standard_normal(1500), DT, [sensorid.hypothesis(
        "white_noise", sigma_v=1.0)], effects=[sensorlab.CATALOGUE["correlated_noise"]])
    names, drawn = curves.view(d).through
    assert names == ("correlated_noise",)
    error = drawn - drawn.mean() - (m - m.mean())
    assert error.std() < 0.5    # of the noise; the process itself is of 2


def test_nine_of_ten_simulated_records_are_inside_a_band(answers):
    d, _ = answers["none"]
    seen = curves.view(d)
    for banded in (seen.allan, seen.spectrum):
        low, high = banded.before
        inside = (banded.record >= low) & (banded.record <= high)
        # points of one record hang together: of 80 bands, at least two thirds
        assert np.all(low <= high) and inside.mean() > 0.66
    assert seen.allan.after is None and seen.through is None and not seen.added
    assert len(seen.residuals) == 1


def test_what_was_found_closes_the_band(answers):
    seen = curves.view(answers["bias_step"][0])
    record = seen.allan.record
    worst = (record / seen.allan.before[1]).argmax()
    low, high = seen.allan.after
    assert record[worst] > 1.5 * seen.allan.before[1][worst]
    assert low[worst] <= record[worst] <= high[worst]
    assert max(p.before for p in seen.places) > seen.places[0].limit
    assert seen.through.names == ("bias_step",)


def test_outliers_are_marked_where_they_are(answers):
    d, record = answers["outliers"]
    odd = np.flatnonzero(curves.view(d).odd)
    assert len(odd) > 5 and np.all(odd % 60 == 0)
    assert curves.view(d).residuals[0].place == "amplitude"
