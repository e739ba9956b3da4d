"""p-values where there is no gap."""

from conftest import DT, MODEL
import generator
import numpy as np
from scipy.stats import binom, kstest

import sensorid
import sensorlab
from sensorlab import Scene
from sensorlab.gap import account, places


def test_p_values_of_records_without_an_effect_are_uniform():
    p = []
    for k, y in enumerate(sensorid.simulate(MODEL, DT, 1000, 60, seed=21).error):
        r = generator.record(31, k)
        scene = Scene(y, DT, dict(temperature=r["temperature"][:1000]))
        p.append(places.distance(scene, account.account(scene, MODEL)).p_value)
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.sum(np.array(p) < 0.05) <= binom.ppf(0.999, 60, 0.05)


def test_what_was_not_fitted_shows_no_gap_where_there_is_none():
    h = [sensorid.hypothesis("markov", tau_m=(50.0, 1000.0), sigma_m=(0.3, 2.0),
                             sigma_v=(0.25, 1.0))]
    squares = []
    for seed in range(6):
        y = sensorid.simulate(h, DT, 1500, seed=seed).error[0]
        fit = account.account(sensorlab.Scene(y[:1000], DT, {}), h)
        gap = places.distance(sensorlab.Scene(y, DT, {}), fit, 99, seed, 1000)
        assert len(gap.statistics.place) == gap.null.shape[1] and gap.p_value > 1e-3
        squares.append(np.mean(gap.distance**2))
    # over 40 seeds 0.97, and 0.22 from one to the next
    assert abs(np.mean(squares) - 1.0) < 4.0 * 0.22 / np.sqrt(6)
