"""The same sensor under other conditions, and in longer records."""

import json
import pathlib

import numpy as np
import pytest
from conftest import paper_case

import sensorid as s
from sensorlab.commands import main
from sensorlab.planning import at_condition, for_longer, length, outlook


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


def test_a_longer_record_of_the_same_sensor_ends_where_it_was_foretold():
    H = (s.hypothesis("random_walk", prior="log", sigma_w=(0.01, 1.0),
                      sigma_v=(0.1, 1.0)),)
    truth = s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5)
    y = s.simulate([truth], 1.0, 4000, 1, seed=3).error[0]
    steps = []
    found = outlook(y[:500], 1.0, H, 4000.0, trials=64,
                    progress=lambda *n: steps.append(n))
    assert [o.label for o in found] == ["random_walk.sigma_w", "random_walk.sigma_v"]
    assert steps == [(1, 1)]
    e = s.identify(y, 1.0, H).best
    later = np.sqrt(np.diag(e.covariance)) / e.mean
    for o, late in zip(found, later):
        assert o.time[0] == 500.0 and o.time[-1] == 4000.0 and o.probability == 1.0
        low, middle, high = o.rsd
        assert low[0] < o.now < high[0] and low[-1] < 1.02 * late < 1.04 * high[-1]
        assert (low <= middle).all() and (middle <= high).all()
    # white noise is known to 1 / sqrt(2 N) at best
    assert found[1].rsd[1, -1] == pytest.approx(1.0 / np.sqrt(8000.0), rel=0.15)


def test_white_noise_is_known_to_one_over_the_root_of_twice_the_samples():
    y = np.random.default_rng(0).standard_normal(100)
    H = (s.hypothesis("white_noise", prior="log", sigma_v=(0.1, 10.0)),)
    (one,) = outlook(y, 0.5, H, trials=20)
    n = one.time / 0.5
    np.testing.assert_allclose(one.rsd[1], 1.0 / np.sqrt(2.0 * n), rtol=0.03)
    answer = length(one, 0.02)
    assert answer.duration == pytest.approx(0.5 * 0.5 / 0.02**2, rel=0.05)
    assert answer.interval[0] <= answer.duration <= answer.interval[1]
    never, now = length(one, 1e-4), length(one, 0.5)
    assert np.isnan(never.duration) and never.interval == (np.inf, np.inf)
    assert never.reached[1] == one.rsd[1, -1] and now.duration == one.time[0]


def test_priors_of_a_longer_record_are_those_of_its_length():
    y = np.random.default_rng(0).standard_normal(400)
    longer = s.default_hypotheses(np.resize(y, 1600), 1.0)
    for h, other in zip(for_longer(s.default_hypotheses(y, 1.0), 4.0), longer):
        for p, q in zip(h.parameters, other.parameters):
            assert (p.low, p.high) == pytest.approx((q.low, q.high), rel=0.02)


def test_what_cannot_be_planned_is_refused():
    y = np.random.default_rng(0).standard_normal(100)
    with pytest.raises(ValueError, match="has 100 s already, a longer one"):
        outlook(y, 1.0, paper_case(3), 50.0)
    with pytest.raises(ValueError, match="3 trials: of fewer than 20"):
        outlook(y, 1.0, paper_case(3), 200.0, trials=3)


def test_plan_says_how_long(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    y = np.random.default_rng(0).standard_normal((2, 300))
    np.savez("r.npz", error=y[0], gx=y[0], gy=y[1], dt=0.1)
    assert main("plan r.npz --hypotheses white_noise --target-rsd sigma_v=0.02 "
                "--target-rsd white_noise.sigma_v=0.02 --json p.json --plot p.png "
                "--trials 20".split()) == 0
    assert "sigma_v is known to 4.1" in capsys.readouterr().out
    answer = json.loads(pathlib.Path("p.json").read_text())
    assert answer["needed"][0]["duration"] == pytest.approx(125.0, rel=0.1)
    assert pathlib.Path("p.png").read_bytes()[:4] == b"\x89PNG"
    for line, message in (
            ("--target-rsd tau=0.1", "--target-rsd tau: there is sigma_v, sigma_w"),
            ("--target-rsd sigma_v=0", "numbers > 0"),
            ("--channel gx,gy", "one channel at a time, not 2"),
            ("--model r.npz --hypotheses markov", "not a JSON model file")):
        assert main(f"plan r.npz {line}".split()) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
