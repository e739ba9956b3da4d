"""Twins: a simulator's own records, measured as the real one is.

What both show is no gap, even where the simulator's description leaves it out.
"""

import numpy as np

from sensorlab.gap.account import account, with_sizes
from sensorlab.gap.causes import further_causes
from sensorlab.gap.distance import distance, enough_trials, p_values
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.readings import as_read

MEASURED = 4       # records of a simulator, or parts of them as long as the real one
TRIALS_TWIN = 60   # simulated records beside each


class Twins:
    """Records of a simulator, less what is taken away from the real one, each beside
    the account that describes it best: its parameters are its own.
    """

    def __init__(self, full, base, records, seed):
        records = np.atleast_2d(np.asarray(records, float))
        self.scenes = [full._replace(y=y) for y in _parts(
            records - np.resize(full.known, records.shape[1]), len(full.y))]
        self.seed = seed
        self._describe(base)

    def _describe(self, like):
        """An account of every record like another, and its distances from that."""
        self.accounts = [account(
            as_read(scene, like.readings), like.bases, like.hypotheses,
            like.signatures, like.readings) for scene in self.scenes]
        self.distances = np.array([distance(scene, acc, min(
            TRIALS_TWIN, enough_trials(scene)), self.seed).distance
            for scene, acc in zip(self.scenes, self.accounts)])

    def show(self, one, acc, scene):
        """Do they show an effect that a record shows, its last in an account, with
        about the same parameters?
        """
        own = self.accounts[0]
        seen = as_read(self.scenes[0], own.readings)
        size = one.effect.size
        (theirs,), (known,) = (with_sizes(a, at, a.theta[None]) for a, at in (
            (own, seen), (acc, scene)))
        theirs = _largest(one, theirs)
        if one.effect.columns and _largest(one, known[:-1]) < LOST * theirs and abs(
                one.values[size][0]) < LARGER * theirs and not self._all_have(one):
            return True    # it moved, as from one of theirs to the next
        look = further_causes(seen, own, [one.effect])
        best = next((c.found[0] for c in look.causes if c.found), None)
        if look.account is None or best.column != one.column or not _is_like(
                one, best.values) or size in best.values and not abs(
                one.values[size][0]) < LARGER * abs(best.values[size][0]):
            return False
        if not one.effect.columns and not _explains(one, look.account, own, seen):
            return False
        self._describe(look.account)    # as the record is
        return True

    def _all_have(self, one):
        """Do several, all of them, have what is like an effect where the first has?"""
        sizes = [_largest(one, with_sizes(acc, as_read(scene, acc.readings),
                                          acc.theta[None])[0])
                 for acc, scene in zip(self.accounts, self.scenes)]
        return len(sizes) > 1 and min(sizes) > LOST * max(sizes)


def _explains(one, richer, acc, scene):
    """Is a scene likelier with an effect as a record has it than without? An account of
    it has the effect as it is there, another has none.
    """
    own = richer.member.effects[-1]
    if own.name != one.name:
        return True    # a parameter that is wrong
    theta = richer.theta.copy()
    for symbol in own.values:
        theta[richer.member.keys.index((own.key, symbol))] = one.values[symbol][0]
    return log_likelihoods(richer.member, scene, richer.signatures, theta[None])[0] > (
        log_likelihoods(acc.member, scene, acc.signatures, acc.theta[None])[0])


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
