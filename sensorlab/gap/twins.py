"""Twins: a simulator's own records, measured as the real one is.

What both show is no gap, even where the simulator's description leaves it out.
"""

from typing import NamedTuple

import numpy as np

from sensorid import Parameter, probabilities
from sensorlab.gap.account import Account, account
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.causes import further_causes
from sensorlab.gap.distance import distance, enough_trials, p_values
from sensorlab.gap.implied import with_sizes
from sensorlab.gap.readings import as_read, readings
from sensorlab.gap.rival import search_cost

MEASURED = 4       # records of a simulator, or parts of them as long as the real one
TRIALS_TWIN = 60   # simulated records beside each


class Have(NamedTuple):
    """Do the records of a simulator have an effect?"""

    probability: float
    account: Account = None    # of the first with it; None where it is described


def _own_readings(scene, some):
    """Readings like some of another record, with the samples of a scene that show each:
    which of them repeat, say, are others in every record.
    """
    if not any(r.masked.any() for r in some):
        return some
    own = {r.found.name: r for r in readings(scene._replace(y=scene.y + scene.known))}
    return tuple(r._replace(found=own[r.found.name].found,
                            masked=own[r.found.name].masked)
                 if r.masked.any() and r.found.name in own else r for r in some)


class Twins:
    """Records of a simulator, less what is taken away from the real one, each beside
    the account that describes it best: its parameters are its own.
    """

    def __init__(self, full, base, records, seed):
        records = np.atleast_2d(np.asarray(records, float))
        self.scenes = [full._replace(y=y) for y in _parts(
            records - np.resize(full.known, records.shape[1]), len(full.y))]
        self.seed = seed
        self.describe(base)

    def describe(self, like):
        """An account of every record like another, and its distances from that; as they
        are described, if it is None.
        """
        if like is None:
            return
        # that their own record tells the parameters, too, would count it twice
        bases, hypotheses = ([h._replace(joint=None) for h in some]
                             for some in (like.bases, like.hypotheses))
        own = [_own_readings(scene, like.readings) for scene in self.scenes]
        self.accounts = [account(as_read(scene, read), bases, hypotheses,
                                 like.signatures, read)
                         for scene, read in zip(self.scenes, own)]
        self.distances = np.array([distance(scene, acc, min(
            TRIALS_TWIN, enough_trials(scene)), self.seed).distance
            for scene, acc in zip(self.scenes, self.accounts)])

    def have(self, one, acc, scene):
        """`Have`: do they have an effect that a record shows, its last in an account,
        with about the same parameters?
        """
        own, size = self.accounts[0], one.effect.size
        (theirs,), (known,) = (with_sizes(a, at, a.theta[None]) for a, at in (
            (own, as_read(self.scenes[0], own.readings)), (acc, scene)))
        theirs = _largest(one, theirs)
        if one.effect.columns and _largest(one, known[:-1]) < LOST * theirs and abs(
                one.values[size][0]) < LARGER * theirs and not self._all_have(one):
            return Have(1.0)    # it moved, as from one of theirs to the next
        if not (one.effect.factor or one.effect.columns):
            return self._likelier_with(acc.member.effects[-1], acc)
        found = next(filter(None, (self._found(one, *their) for their in zip(
            self.accounts, self.scenes))), None)
        return Have(float(found is not None), found)

    def _found(self, one, own, scene):
        """The account of one of theirs with an effect like one of the record's, if it
        is found there and as large; or None.
        """
        size, seen = one.effect.size, as_read(scene, own.readings)
        look = further_causes(seen, own, [one.effect])
        best = next((c.found[0] for c in look.causes if c.found), None)
        alike = look.account is not None and best.column == one.column and _is_like(
            one, best.values) and (size not in best.values or abs(
                one.values[size][0]) < LARGER * abs(best.values[size][0]))
        return look.account if alike else None

    def _likelier_with(self, effect, acc):
        """`Have` of an effect inside the filter as an account of the record has it: all
        of theirs have it so, or none, or each in another way, at even odds. One of them
        alone may show it weakly.
        """
        def values(symbol):
            return acc.member.value(acc.sample.theta, effect.key, symbol)
        free = {p.symbol: p for p in effect.effect.parameters(self.scenes[0])}
        there = {symbol: _within(p, values(symbol), acc.sample.weight)
                 for symbol, p in free.items()}
        (there, _), (each, as_each) = (self._with(effect._replace(
            values={**effect.values, **own})) for own in (there, free))
        return Have(float(probabilities([there, 0.0, each])[0]), as_each[0])

    def _with(self, effect):
        """Log evidence over that of their accounts, nats, with one more effect inside
        the filter, and these accounts; without signatures that need not be there then:
        a walk may have been described as a drift.
        """
        kept, price = self.accounts[0].signatures, 0.0    # of all that it is without
        most, best = self._fitted(effect, kept)
        for one in kept:
            fewer = tuple(s for s in kept if s is not one)
            less = price + np.log(len(CATALOGUE)) + search_cost(
                one.found.effect, self.scenes[0])
            gain, others = self._fitted(effect, fewer)
            if gain + less > most:
                kept, price, most, best = fewer, less, gain + less, others
        return most, best

    def _fitted(self, effect, signatures):
        """The same with these signatures."""
        result = [account(
            as_read(scene, own.readings), own.bases, [h.joined(effect)
                                                      for h in own.hypotheses],
            signatures, own.readings, own)
            for scene, own in zip(self.scenes, self.accounts)]
        return sum(other.log_evidence - own.log_evidence
                   for other, own in zip(result, self.accounts)), result

    def _all_have(self, one):
        """Do several, all of them, have what is like an effect where the first has?"""
        sizes = [_largest(one, with_sizes(acc, as_read(scene, acc.readings),
                                          acc.theta[None])[0])
                 for acc, scene in zip(self.accounts, self.scenes)]
        return len(sizes) > 1 and min(sizes) > LOST * max(sizes)


def _within(p, values, weight):
    """A parameter in the range in which a weighted sample (M,) has it with 90 %, and
    what may change from one record of a sensor to the next.
    """
    order = np.argsort(values)
    low, high = values[order][np.searchsorted(
        np.cumsum(weight[order]), [0.05, 0.95]).clip(0, len(values) - 1)]
    moved = 0.0 if p.symbol == "onset" else MOVED
    return Parameter(p.symbol, *np.clip([low * (1.0 - moved), high * (1.0 + moved)],
                                        p.low, p.high).tolist())


def _largest(one, signatures):
    """Largest size of signatures, as `Found`, that are like an effect."""
    return max((abs(f.values[f.effect.size].low) for f in signatures
                if (f.name, f.column) == (one.name, one.column) and _is_like(
                    one, {symbol: (p.low, 0.0) for symbol, p in f.values.items()})),
               default=0.0)


def _is_like(one, values):
    """Are parameters, (mean, sd) by symbol, those of an effect but for size and phase?
    """
    return all(_alike(symbol, one.values[symbol], value)
               for symbol, value in values.items()
               if symbol not in (one.effect.size, "phase"))


def _parts(records, N):
    """Some parts (N,) of records (L, M), evenly from all; of a shorter one, the rest is
    missing.
    """
    L, M = records.shape
    whole = max(M // N, 1) * N
    padded = np.full((L, max(whole, M)), np.nan)
    padded[:, :M] = records
    parts = padded[:, :whole].reshape(-1, N)
    return parts[np.unique(np.linspace(0, len(parts) - 1, MEASURED).astype(int))]


ALIKE = 3.0     # standard errors by which two estimates of one parameter may differ
LOST = 0.5      # of a size: less of it is left where its frequency has moved
LARGER = 2.0    # times as large a size is no longer what they show
MOVED = 0.2     # of a parameter, from one record of a sensor to the next: vibration is
                # no pure line


def _alike(symbol, one, other):
    (mean, sd), (again, its_sd) = one, other
    if isinstance(mean, str):
        return mean == again
    moved = 0.0 if symbol == "onset" else MOVED * abs(mean)
    return abs(mean - again) <= ALIKE * np.hypot(sd, its_sd) + moved


UNLIKE = 0.1    # of a distance that two records share: what they may differ by


def less_shared(gap, own):
    """The gap less what the simulator's own records `own` (L, S) have, too. What they
    alone have is a matter of their description, and none of the record: nothing stands
    out more than it does beside the simulator.
    """
    d, mean = gap.distance, own.mean(0)
    shared = np.clip(mean, np.minimum(d, 0.0), np.maximum(d, 0.0))
    spread = np.maximum(own.std(0, ddof=1), 1.0) if len(own) > 2 else 1.0
    # of the mean of theirs, too, where it is taken off
    wide = spread**2 + np.minimum(spread**2 / len(own), shared**2)
    d = (d - shared) / np.sqrt(wide + (UNLIKE * shared)**2)
    p_place, p_value = p_values(gap.statistics.place, gap.ruler.usable, d, gap.null)
    return gap._replace(distance=d, p_place=p_place, p_value=p_value)
