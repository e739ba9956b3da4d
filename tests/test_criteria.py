import numpy as np
import pytest
from conftest import paper_case, same, thorough
from numpy.testing import assert_allclose

import sensorid as s


def curves(c):
    return dict(zip(("error", *c.labels), (c.error_probability, *c.rsd)))


@pytest.mark.parametrize("number", [1, 2, thorough(3)])
def test_real_and_calculated_criteria_coincide(number):
    """The paper's own test of validity, for every parameter at several times.

    4.3 standard errors: 1e-5 a comparison, 1e-3 for all of them together.
    """
    c = s.criteria(paper_case(number), 1.0, 1500.0, 2048, seed=5,
                   times=[1, 5, 50, 500, 1500])
    for label, curve in curves(c).items():
        assert (np.abs(curve.z) < 4.3).all(), (label, curve.z)


def test_few_samples_leave_what_is_known_a_priori():
    """One sample tells nothing of a walk or of the time of a Markov process: the mean
    of their posterior variances is that of the prior.
    """
    c = s.criteria(paper_case(3), 1.0, 20.0, 64, seed=0, times=[1.0])
    calculated = dict(zip(c.labels, (curve.calculated[0] for curve in c.rsd)))
    for h in paper_case(3):
        p = h.parameters[0]
        told = calculated[f"{h.name}.{p.symbol}"]
        assert abs(told / (p.sd / p.mean) - 1.0) < 0.01


@pytest.mark.large
def test_case_2_at_a_tenth_of_a_second_has_the_known_values():
    """Error about 1 %, RSD of sigma_w 2.2 %, tau_m 33 %, sigma_m 18 % (independent
    run)."""
    c = s.criteria(paper_case(2), 0.1, 2000.0, 200, seed=1, times=[2000.0])
    found = curves(c)
    assert abs(found["error"].real[0] - 0.01) < 3 * np.sqrt(0.01 * 0.99 / 200)
    for label, value in (("random_walk.sigma_w", 0.022), ("markov.tau_m", 0.33),
                         ("markov.sigma_m", 0.18)):
        curve = found[label]
        assert abs(curve.real[0] - value) < 3 * curve.real_se[0] + 0.02 * value
    assert all((reached >= s.NODES_PER_SD).all() for reached in c.nodes_per_sd)


def test_without_data_the_rsd_is_the_priors():
    H = [s.hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=1e4),
         s.hypothesis("random_walk", name="twin", sigma_w=(0.04, 0.15), sigma_v=1e4)]
    c = s.criteria(H, 1.0, 3.0, 4096, seed=2)
    prior = (0.15 - 0.04) / np.sqrt(12) / 0.095
    for curve in c.rsd:
        assert abs(curve.real[-1] - prior) < 4 * curve.real_se[-1]
        # quadrature: 12 nodes
        assert abs(curve.calculated[-1] - prior) < 2e-3 * prior
    assert abs(c.error_probability.calculated[-1] - 0.5) < 1e-6


def test_a_coarse_uniform_grid_separates_real_and_calculated():
    H = paper_case(2)
    grids = [s.uniform_grid(h, 0.2, 4) for h in H]
    c = s.criteria(H, 0.2, 1000.0, 1500, seed=3, times=[1000.0], grids=grids)
    assert c.error_probability.z[0] > 4


@pytest.mark.large
def test_criteria_are_the_same_bits_for_any_chunks(monkeypatch):
    H = paper_case(3)
    whole = s.criteria(H, 1.0, 200.0, 150, seed=4)
    monkeypatch.setattr(s, "CHUNK", 64)
    same(whole, s.criteria(H, 1.0, 200.0, 150, seed=4))


def test_a_damaged_chunk_is_computed_again(tmp_path):
    H = paper_case(2)
    first = s.criteria(H, 1.0, 50.0, 32, seed=4, checkpoint=tmp_path)
    for damage in (b"", b"not a chunk"):
        next(tmp_path.iterdir()).write_bytes(damage)
        same(first, s.criteria(H, 1.0, 50.0, 32, seed=4, checkpoint=tmp_path))


def test_parameters_of_other_truths_are_compared_by_symbol():
    walk = s.hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=(0.25, 1.0))
    white = s.hypothesis("white_noise", sigma_v=(0.25, 1.0))
    c = s.criteria([walk, white], 1.0, 300, trials=64, times=[300], truths=[
        s.hypothesis("markov", tau_m=(60, 1500), sigma_m=(0.5, 1.5),
                     sigma_v=(0.25, 1.0)), white])
    # a walk has no tau_m, a Markov process no sigma_w
    assert c.labels == ("random_walk.sigma_v", "white_noise.sigma_v")
    assert all(0.02 < curve.real[0] < 0.1 for curve in c.rsd)


def test_about_zero_nothing_is_relative():
    h = s.hypothesis("rate_ramp", slope=(-0.1, 0.1), sigma_v=1.0)
    c = s.criteria([h], 1.0, 20.0, 16, seed=1)
    assert np.isnan(c.rsd[0].real).all()


def test_an_interrupted_run_is_taken_up_with_the_same_bits(tmp_path):
    H = paper_case(2)

    def stop(done, total):
        if done > 128:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        s.criteria(H, 1.0, 100.0, 400, seed=4, checkpoint=tmp_path, progress=stop)
    kept = {file.name: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    assert len(kept) == 2
    same(s.criteria(H, 1.0, 100.0, 400, seed=4, checkpoint=tmp_path),
         s.criteria(H, 1.0, 100.0, 400, seed=4))
    assert kept.items() <= {f.name: f.stat().st_mtime_ns
                            for f in tmp_path.iterdir()}.items()
    s.criteria(H, 1.0, 100.0, 400, seed=5, checkpoint=tmp_path)
    assert len(list(tmp_path.iterdir())) == 8


@pytest.mark.parametrize("change, message", [
    (dict(dt=0.0), "0 < dt <= duration"), (dict(duration=0.5), "0 < dt <= duration"),
    (dict(trials=15), "15 trials of 2 hypotheses: a criterion needs at least 16"),
    (dict(trials=20.5), "numbers of trials 20.5: whole numbers"),
    (dict(algorithms=[max]), "a dict of functions is needed"),
    (dict(algorithms=dict(mine=lambda *record: None)), "algorithm mine returns None"),
    (dict(algorithms=dict(mine=lambda *record: (2, [[0.1], [1.0, 1.0]]))),
     "the number of the hypothesis that it chooses"),
    (dict(times=[500.0]), "do not lie within"),
    (dict(times=[]), "times \\[\\]: one or more finite numbers"),
    (dict(times=["late"]), "one or more finite numbers"),
    (dict(times=[10.0, np.nan]), "one or more finite numbers"),
    (dict(duration=[50.0]), "two numbers, 0 < dt <= duration"),
    (dict(truths=paper_case(2)[:1]), "1 truths of 2 hypotheses: one for each"),
    (dict(grids=[None]), "1 grids of 2 hypotheses: one for each"),
    (dict(grids=[s.grid(h, 1.0, 3) for h in paper_case(1)[::-1]]),
     "a grid of markov at 1 s stands where one of random_walk"),
    (dict(checkpoint=__file__), "is a file: a folder is needed")])
def test_senseless_runs_are_refused(change, message):
    arguments = dict(dt=1.0, duration=100.0, trials=20) | change
    with pytest.raises(ValueError, match=message):
        s.criteria(paper_case(2), **arguments)


@pytest.mark.thorough
# ---- how long must be recorded

def test_criteria_meet_their_targets_at_the_length_that_is_named():
    H = paper_case(2)
    for n in s.record_length(H, 0.2, 1000.0, 0.06, dict(sigma_w=0.1), 2000, seed=6):
        assert n.interval[0] <= n.duration <= n.interval[1] < 1000.0 and not n.reason
        c = s.criteria(H, 0.2, n.duration, 1000, seed=7, times=[n.duration])
        curve = curves(c)[n.label.replace("error_probability", "error")]
        # at the ends of the interval the criterion is as far off as the answer may be
        assert abs(curve.real[0] - n.target) < 3.0 * curve.real_se[0] + 0.05 * n.target


def test_what_cannot_be_reached_is_said_with_its_reason():
    H = paper_case(2)
    error, tau = s.record_length(H, 1.0, 300.0, 0.001, {"markov.tau_m": 0.01}, 200)
    assert np.isnan(error.duration) and np.isnan(tau.duration)
    assert error.interval[1] == np.inf and error.reached > 0.001
    assert "taken for" in error.reason and "power" in tau.reason


@pytest.mark.parametrize("change, message", [
    (dict(), "no target is given"), (dict(error=1.5), "0 < target < 1"),
    (dict(rsd=0.1), "rsd is 0.1: a dict of parameters"),
    (dict(rsd=dict(sigma_v=0.1)), "RSD 0.1 of sigma_v: a target > 0 is needed, of "),
    (dict(rsd=dict(tau_m=0.0)), "a target > 0"),
    (dict(rsd=dict(walk=0.1), trials=1), "a target > 0")])
def test_senseless_targets_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        s.record_length(paper_case(2), 1.0, 100.0, **{"trials": 16, **change})


def test_criteria_are_of_one_hypothesis_or_several_and_of_a_whole_seed():
    h = s.hypothesis("white_noise", sigma_v=(0.5, 2.0))
    one, several = s.criteria(h, 1.0, 20.0, 48), s.criteria([h], 1.0, 20.0, 48)
    assert_allclose(one.rsd[0].real, several.rsd[0].real)
    with pytest.raises(ValueError, match="there is no hypothesis"):
        s.criteria([], 1.0, 20.0)
    with pytest.raises(ValueError, match="the seed is -1"):
        s.record_length(h, 1.0, 500.0, rsd={"sigma_v": 0.1}, seed=-1)
