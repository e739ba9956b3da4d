"""Effects of a user's own: which can be looked for, stored and sent to a process."""

import pickle

import numpy as np
import pytest
from conftest import DT, WHITE

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Effect, Found, Model, Scene, Simulator
from sensorlab.gap.own import as_effects

Y = np.random.default_rng(0).normal(size=200)


def warm_up(scene, x, psi):
    yield "", np.sqrt(scene.time)[:, None]


def priors(*ends):
    return lambda scene: [sensorid.Parameter(f"p{k}", *one)
                          for k, one in enumerate(ends)]


def test_effects_are_given_as_one_as_several_or_by_their_names():
    own = Effect("warm_up", columns=warm_up)
    assert as_effects() == as_effects(CATALOGUE) == tuple(CATALOGUE.values())
    assert as_effects(own) == as_effects([own]) == (own,)
    assert as_effects(["sinusoid", own]) == (CATALOGUE["sinusoid"], own)
    assert as_effects("sinusoid") == (CATALOGUE["sinusoid"],)


@pytest.mark.parametrize("effects, said", [
    (["sinusoids"], "'sinusoids' is no effect"),
    ([3], "3 is no effect"),
    ([Effect("x")], "the effect x does nothing"),
    ([Effect("a+b", columns=warm_up)], "the name of an effect is 'a+b'"),
    ([Effect("unknown", columns=warm_up)], "the name of an effect is 'unknown'"),
    ([Effect("x", columns=warm_up), Effect("x", columns=warm_up)],
     "two effects are called x"),
    ([Effect("x", reading=lambda scene, y: None)], "alters what is read"),
    ([Effect("x", factor=-3.0)], "the factor of the effect x is -3"),
    ([Effect("x", columns=warm_up, search="anywhere")], "is 'anywhere': one of"),
    ([Effect("x", columns=warm_up, parameters=priors((0.0, 1.0), (0.0, 1.0)))],
     "x has 2 parameters: one or none"),
    ([Effect("x", columns=warm_up, search="onset")], "x has 0 parameters: 1 "),
    ([Effect("x", columns=warm_up, parameters=priors((1.0, 1.0)))], "low < high"),
    ([Effect("x", columns=warm_up, parameters=priors((0.0, 1.0, True)))], "low > 0"),
    ([Effect("x", columns=lambda scene, x, psi: [("", scene.time[:, None] / 0.0)])],
     "builds columns with nan at sample 0: finite real numbers"),
    ([Effect("x", columns=lambda scene, x, psi: [("", 1j * scene.time[:, None])])],
     "builds columns with complex numbers: finite real numbers"),
])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning",
                            "ignore:divide by zero:RuntimeWarning")
def test_what_cannot_be_looked_for_is_refused_by_name(effects, said):
    with pytest.raises(ValueError, match=said.replace("+", r"\+")):
        sensorlab.diagnose(Y, DT, WHITE, effects=effects)


@pytest.mark.parametrize("trials", [0, 1, 8, 20.5])
def test_simulated_records_are_a_whole_number_and_not_few(trials):
    with pytest.raises(ValueError, match="numbers of simulated records .* >= 9"):
        sensorlab.diagnose(Y, DT, WHITE, trials=trials)


@pytest.mark.parametrize("seed", [-1, 1.5, None, True, "1"])
def test_a_seed_is_a_whole_number(seed):
    for drawn in (lambda: sensorid.simulate(WHITE, DT, 20, seed=seed),
                  lambda: sensorlab.diagnose(Y, DT, WHITE, seed=seed)):
        with pytest.raises(ValueError, match="the seed is .*: a whole number >= 0"):
            drawn()


@pytest.mark.parametrize("change, said", [
    (dict(bias_sigma=-1.0), "bias_sigma = -1.0 of white_noise"),
    (dict(bias_sigma=np.nan), "bias_sigma = nan of white_noise"),
    (dict(parameters=(sensorid.Parameter("sigma_v", 2.0, 1.0),)),
     "sigma_v of white_noise from 2.0 to 1.0: two numbers, low <= high")])
def test_a_hypothesis_that_was_altered_is_checked_again(change, said):
    h = WHITE[0]._replace(**change)
    for asked in (lambda: sensorid.identify(Y, DT, [h]),
                  lambda: sensorlab.diagnose(Y, DT, [h])):
        with pytest.raises(ValueError, match=said):
            asked()


def test_an_answer_goes_to_another_process_and_back():
    d = sensorlab.diagnose(Y + 2.0 * (np.arange(200) > 90), DT, WHITE)
    again = pickle.loads(pickle.dumps(d))
    assert again.verdict == d.verdict == "bias_step"
    assert again.found[0].effect is CATALOGUE["bias_step"]
    assert all(pickle.loads(pickle.dumps(e)) is e for e in CATALOGUE.values())
    own = Effect("warm_up", columns=warm_up)
    assert pickle.loads(pickle.dumps(own)) == own


def test_every_hypothesis_of_a_simulator_has_its_effects():
    step = Found(CATALOGUE["bias_step"], values=dict(onset=30.0, size=2.0))
    one = Simulator((*WHITE, *WHITE), ((step,),))
    with pytest.raises(ValueError, match="2 hypotheses and the effects of 1"):
        sensorlab.simulate_effects(one, Scene(Y, DT, {}))


def test_a_model_file_has_what_it_can_give_back():
    def random_walk(dt, sigma_w):
        return sensorid.shaping_filter([[1.0]], [[7.0 * sigma_w]], [1.0])
    own = sensorid.hypothesis(random_walk, sigma_w=1.0)
    with pytest.raises(ValueError, match="the model of random_walk is one of your own"):
        sensorlab.model_text(Model(DT, "u", Simulator((own,))))
    step = Found(CATALOGUE["bias_step"]._replace(size="height"), values=dict(
        onset=30.0, height=2.0))
    with pytest.raises(ValueError, match="the effect bias_step is one of your own"):
        sensorlab.model_text(Model(DT, "u", Simulator(tuple(WHITE), ((step,),))))


def test_a_recording_is_no_array_and_one_record_is_several(tmp_path):
    file = tmp_path / "r.csv"
    np.savetxt(file, np.column_stack([np.arange(200), Y]), delimiter=",",
               header="time,error", comments="")
    record = sensorlab.read(file)
    with pytest.raises(ValueError, match="a Recording stands .*: give its .error"):
        sensorlab.diagnose(record, DT, WHITE)
    for one in (record, str(file), file):
        assert len(sensorlab.identify_many(one, WHITE).rows) == 1
    for missing in (-9999.0, "-9999", [-9999], ["-9999"]):
        lost = np.where(np.arange(200) % 50 == 7, -9999.0, Y)
        assert np.isnan(sensorlab.read(lost, dt=DT, missing=missing).error).sum() == 4
    with pytest.raises(ValueError, match="missing is 'lost': a number, or several"):
        sensorlab.read(Y, dt=DT, missing="lost")
