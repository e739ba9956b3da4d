"""Finished trials are found again by the same run, and by no other."""

import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest
from conftest import paper_case, same

import sensorid as s
from sensorlab import ALGORITHMS

RUN = dict(dt=1.0, duration=40.0, trials=16, seed=1)


def keys_in_another_process(tmp_path, code):
    """Output lines of a script that can import `mine` from its folder."""
    (tmp_path / "run.py").write_text("import functools, numpy as np, sensorid as s\n"
                                     "from sensorid import fingerprint\n"
                                     + textwrap.dedent(code))
    done = subprocess.run([sys.executable, "run.py"], cwd=tmp_path, text=True,
                          capture_output=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


MODEL = """
    def closed(k):
        def own(dt, sigma_v):
            return s.white_noise(dt, k * sigma_v)
        return own
    print(fingerprint(closed(1.0)), fingerprint(closed(1.0)), fingerprint(closed(2.0)))
    """


def test_a_function_is_known_by_its_closure_in_every_process(tmp_path):
    one, again, other = keys_in_another_process(tmp_path, MODEL)
    assert one == again != other
    assert keys_in_another_process(tmp_path, MODEL) == [one, again, other]


def test_what_is_typed_at_a_prompt_is_known_by_its_closure():
    code = "import sensorid as s\nfrom sensorid import fingerprint\n" + textwrap.dedent(
        MODEL)
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    one, again, other = done.stdout.split()
    assert one == again != other


@pytest.mark.large
def test_a_function_is_known_by_its_helpers_wherever_they_stand(tmp_path):
    code = """
        import helper
        factor = {factor}
        def inner(x): return factor * helper.twice(x)
        def own(dt, sigma_v):
            return s.white_noise(dt, [inner(v) for v in [sigma_v]][0])
        print(fingerprint(own))
        """
    keys = []
    for factor, twice in ((1, "2 * x"), (1, "2 * x"), (3, "2 * x"), (1, "x + x + 0")):
        (tmp_path / "helper.py").write_text(f"def twice(x): return {twice}\n")
        keys += keys_in_another_process(tmp_path, code.format(factor=factor))
    assert keys[0] == keys[1] and len(set(keys)) == 3


def test_functions_of_libraries_and_classes_of_a_user_have_a_key(tmp_path):
    code = """
        from sensorlab import ALGORITHMS
        class Model:
            k = {k}
            def __init__(self, c): self.c = c
            def __call__(self, dt, sigma_v): return s.white_noise(dt, {k} * sigma_v)
        print(fingerprint(tuple(ALGORITHMS.values())), fingerprint(Model(1)),
              fingerprint(Model(2)), fingerprint(functools.partial(np.exp, 1.0)),
              fingerprint(np.arange(3), "a", {{1: 2.0}}))
        """
    one, two, three = (keys_in_another_process(tmp_path, code.format(k=k))
                       for k in (1, 1, 2))
    assert one == two and len(set(one)) == 5
    assert [a == b for a, b in zip(one, three)] == [True, False, False, True, True]


@pytest.mark.thorough
def test_kept_trials_of_other_algorithms_are_found_again(tmp_path):
    code = """
        from sensorlab import ALGORITHMS
        h = [s.hypothesis("white_noise", sigma_v=(0.3, 1.0)),
             s.hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=0.5)]
        pick = dict((k, ALGORITHMS[k]) for k in ("slopes", "gmwm", "whittle"))
        s.criteria(h, 1.0, 40.0, 16, 1, algorithms=pick, checkpoint="kept")
        import os
        print(*sorted(os.listdir("kept")))
        """
    first = keys_in_another_process(tmp_path, code)
    assert first and keys_in_another_process(tmp_path, code) == first


@pytest.mark.large
def test_another_closure_is_another_run(tmp_path):
    def algorithm(choice):
        return lambda y, dt, hypotheses: (choice, [np.array([p.mean for p in
                                                             h.parameters])
                                                   for h in hypotheses])
    for choice in (0, 1, 0):
        kept, fresh = (s.criteria(paper_case(2), **RUN, checkpoint=folder, algorithms={
            "mine": algorithm(choice)}) for folder in (tmp_path, None))
        same(kept, fresh)
        assert (kept.rivals["mine"].error_probability
                == fresh.rivals["mine"].error_probability).all()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.large
def test_what_has_no_contents_is_refused(tmp_path):
    lock = threading.Lock()

    def own(dt, sigma_v):
        with lock:
            return s.white_noise(dt, sigma_v)
    h = [s.hypothesis(own, sigma_v=(0.3, 1.0)), paper_case(2)[0]]
    with pytest.raises(ValueError, match="the checkpoint cannot tell these arguments"):
        s.criteria(h, **RUN, checkpoint=tmp_path)
    s.criteria(h, **RUN)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_algorithms_take_any_sequence(name):
    H = paper_case(2)
    y = s.simulate(H, 1.0, 200, seed=1).error[0]
    one, two = (ALGORITHMS[name](list(y) if kind is list else y, 1.0, kind(H))
                for kind in (list, tuple))
    assert one[0] == two[0]
    for a, b in zip(one[1], two[1]):
        np.testing.assert_array_equal(a, b)
