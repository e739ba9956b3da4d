"""The effects that are looked for, a user's own among them: what these must be."""

from collections import Counter
from collections.abc import Iterable, Mapping

from sensorid import Parameter
from sensorlab.gap.catalogue import CATALOGUE, is_known
from sensorlab.gap.effects import Effect

SEARCHES = dict(onset=1, frequency=1, pulse=2, waves=3)    # parameters of columns, ...
OF_MODELS = "", "onset", "spectrum", "band"                # ... and those of models
DOES = "columns", "model", "jumps", "reading", "factor"
TAKEN = "none", "unknown", "undecided"    # verdicts


def as_effects(effects=None):
    """Effects, by default those of the catalogue, as a tuple: one or several, or names
    of the catalogue; ValueError where one is none, or has a name that no verdict can
    have.
    """
    if effects is None or isinstance(effects, Mapping):
        effects = (CATALOGUE if effects is None else effects).values()
    one = isinstance(effects, (str, Effect)) or not isinstance(effects, Iterable)
    some = [effects] if one else effects
    result = tuple(map(_as_effect, some))
    twice = [name for name, times in Counter(e.name for e in result).items()
             if times > 1]
    if twice:
        raise ValueError(f"two effects are called {twice[0]}: each needs a name of its "
                         "own")
    return result


def _as_effect(one):
    """One of `as_effects`."""
    if isinstance(one, str) and one in CATALOGUE:
        return CATALOGUE[one]
    if not isinstance(one, Effect):
        raise ValueError(f"{one!r} is no effect: an Effect or a name in CATALOGUE is "
                         "needed")
    if not isinstance(one.name, str) or not one.name.isidentifier() or (
            one.name in TAKEN):
        raise ValueError(f"the name of an effect is {one.name!r}: letters, digits and "
                         f"_ are needed; {', '.join(TAKEN)} are verdicts")
    if not is_known(one):
        _check_own(one)
    return one


def _check_own(one):
    """Refuse an effect of a user's own that cannot be looked for."""
    if not any(getattr(one, field) for field in DOES):
        raise ValueError(f"the effect {one.name} does nothing: one of "
                         f"{', '.join(DOES)} is needed")
    if one.reading:
        raise ValueError(f"the effect {one.name} alters what is read: a simulator can "
                         "have one of your own, but of these those of the catalogue "
                         "alone are looked for")
    if one.factor and not one.factor > 1.0:
        raise ValueError(f"the factor of the effect {one.name} is {one.factor!r}: a "
                         "number > 1 is needed")
    known = ("", *SEARCHES) if one.columns else OF_MODELS
    if one.search not in known:
        raise ValueError(f"the search of the effect {one.name} is {one.search!r}: one "
                         f"of {', '.join(map(repr, known))} is needed")


def check_parameters(effects, scene):
    """Refuse effects of a user's own with parameters that cannot be looked for."""
    for one in effects:
        if is_known(one):
            continue
        priors = tuple(one.parameters(scene))
        for p in priors:
            if not isinstance(p, Parameter) or not p.free or p.log and not p.low > 0.0:
                raise ValueError(f"a parameter of the effect {one.name} is {p!r}: a "
                                 "Parameter with low < high is needed, low > 0 if log")
        few, many = (SEARCHES[one.search],) * 2 if one.search in SEARCHES else (0, 1)
        if one.columns and not few <= len(priors) <= many:
            raise ValueError(f"the effect {one.name} has {len(priors)} parameters: "
                             f"{few if few == many else 'one or none'} beside its size "
                             f"with the search {one.search!r}")
