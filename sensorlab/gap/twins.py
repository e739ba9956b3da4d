"""Twins: a simulator's own records, measured as the real one is.

What both show is no gap, even where the simulator's description leaves it out.
"""

import numpy as np

from sensorlab.gap.account import account
from sensorlab.gap.causes import further_causes
from sensorlab.gap.distance import p_values
from sensorlab.gap.readings import as_read


class Twins:
    """Records of a simulator, less what is taken away from the real one."""

    def __init__(self, full, base, gap, records):
        records = np.atleast_2d(np.asarray(records, float))
        self.records = records - np.resize(full.known, records.shape[1])
        self.distances = _of_others(gap, self.records)
        scene = full.cut(slice(records.shape[1]))
        self.scene = as_read(scene._replace(y=self.records[0, :len(scene.y)]),
                             base.readings)
        self.account = account(
            self.scene, base.bases, base.hypotheses,
            tuple(s._replace(columns=s.columns[:len(scene.y)])
                  for s in base.signatures), base.readings)

    def show(self, one):
        """Do they show an effect that a record shows, with the same parameters?"""
        look = further_causes(self.scene, self.account, [one.effect])
        best = next((c.found[0] for c in look.causes if c.found), None)
        size = one.effect.size
        if look.account is None or best.column != one.column or not all(
                abs(one.values[symbol][0]) < LARGER * abs(value[0]) if symbol == size
                else _alike(symbol, one.values[symbol], value)
                for symbol, value in best.values.items() if symbol != "phase"):
            return False
        self.account = look.account    # described as the record is
        return True


    def follow(self, gap, acc):
        """Measure them by the ruler of a gap to an account that describes them, too."""
        if _inside(acc) == _inside(self.account):
            self.distances = _of_others(gap, self.records)


def _inside(acc):
    """Names of all effects of an account."""
    return sorted([*(one.key for one in acc.member.effects), *(
        s.found.name for s in acc.signatures)])


ALIKE = 3.0     # standard errors by which two estimates of one parameter may differ
LARGER = 2.0    # times as large a size is no longer what they show
MOVED = 0.2     # of a parameter, from one record of a sensor to the next: vibration is
                # no pure line


def _alike(symbol, one, other):
    (mean, sd), (again, its_sd) = one, other
    if isinstance(mean, str):
        return mean == again
    moved = 0.0 if symbol == "onset" else MOVED * abs(mean)
    return abs(mean - again) <= ALIKE * np.hypot(sd, its_sd) + moved


def _of_others(gap, records):
    """Distances (L', S) of other records (L, M) like that of a gap: of all their parts
    as long as it; of a shorter one, the rest is missing.
    """
    N = len(gap.z)
    whole = max(records.shape[1] // N, 1) * N
    padded = np.full((len(records), max(whole, records.shape[1])), np.nan)
    padded[:, :records.shape[1]] = records
    return gap.ruler.measured(padded[:, :whole].reshape(-1, N))


UNLIKE = 0.1    # of a distance that two records share: what they may differ by


def less_shared(gap, own, before=None):
    """The gap less what the simulator's own records `own` (L, S) have, too; `before` is
    the gap without effects that goes with one with.
    """
    L = len(own)
    mean = own.mean(0)
    spread = np.maximum(own.std(0, ddof=1), 1.0) if L > 2 else 1.0
    wide = np.sqrt((1.0 + 1.0 / L) * spread**2 + (UNLIKE * mean)**2)

    def less(d, null):    # records of a simulator beside as many others of it
        others = np.mean([null[(np.arange(len(d)) - k - 1) % len(null)]
                          for k in range(L)], axis=0)
        return (d - others) / np.sqrt(1.0 + 1.0 / L)
    null = less(gap.null, gap.null)
    d = (gap.distance - mean) / wide
    p_place, p_value = p_values(gap.statistics.place, gap.ruler.usable, d, null)
    return gap._replace(distance=d, null=null, p_place=p_place, p_value=p_value,
                        beside=gap.beside if gap.beside is None else
                        less(gap.beside, before.null))
