"""Twins: a simulator's own records, measured as the real one is.

What both show is no gap, even where the simulator's description leaves it out.
"""

import numpy as np

from sensorlab.gap.account import account, with_sizes
from sensorlab.gap.causes import further_causes
from sensorlab.gap.distance import distance, enough_trials, p_values
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
                one.values[size][0]) < LARGER * theirs:
            return True    # it moved: what they have the record has not
        look = further_causes(seen, own, [one.effect])
        best = next((c.found[0] for c in look.causes if c.found), None)
        if look.account is None or best.column != one.column or not _is_like(
                one, best.values) or size in best.values and not abs(
                one.values[size][0]) < LARGER * abs(best.values[size][0]):
            return False
        self._describe(look.account)    # as the record is
        return True


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


def less_shared(gap, own, before=None):
    """The gap less what the simulator's own records `own` (L, S) have, too; `before` is
    the gap without effects that goes with one with. What they alone have is a matter of
    their description, and none of the record.
    """
    L = len(own)
    mean = _no_further(own.mean(0), gap.distance)
    spread = np.maximum(own.std(0, ddof=1), 1.0) if L > 2 else 1.0
    wide = np.sqrt((1.0 + 1.0 / L) * spread**2 + (UNLIKE * mean)**2)

    def less(d, null):    # records of a simulator beside as many others of it
        others = np.mean([null[(np.arange(len(d)) - k - 1) % len(null)]
                          for k in range(L)], axis=0)
        return (d - _no_further(others, d)) / np.sqrt(1.0 + 1.0 / L)
    null = less(gap.null, gap.null)
    d = (gap.distance - mean) / wide
    p_place, p_value = p_values(gap.statistics.place, gap.ruler.usable, d, null)
    return gap._replace(distance=d, null=null, p_place=p_place, p_value=p_value,
                        beside=gap.beside if gap.beside is None else
                        less(gap.beside, before.null))


def _no_further(shared, d):
    """Distances that others have, as far as they are towards those of a record."""
    return np.clip(shared, np.minimum(d, 0.0), np.maximum(d, 0.0))
