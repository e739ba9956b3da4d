"""The verdict: what is found, and whether something more is left."""

import numpy as np

from sensorlab.gap.catalogue import FAMILIES
from sensorlab.gap.causes import UNKNOWN, Cause
from sensorlab.gap.distance import log_p_error
from sensorlab.gap.effects import Found
from sensorlab.gap.remainder import SLIGHT
from sensorlab.gap.search import scaled

PRIOR_UNKNOWN = 0.1     # that what is missing is in no catalogue
MISSING_NATS = 10.0     # mean of -ln p where something is missing: what can be named
SURE = 0.5              # what is named is more probable than not
RARE = 0.1              # share of what is named in which another effect is not worth
                        # a word


def unknown_probability(p_value):
    """That something is still missing, from the p-value of what is left.

    -ln p is exponential: of mean 1 where nothing is missing, of mean MISSING_NATS
    where something is (T. Sellke, M. Bayarri, J. Berger, "Calibration of p values",
    Am. Stat. 55, 2001).
    """
    log_odds = (np.log(PRIOR_UNKNOWN / (1.0 - PRIOR_UNKNOWN) / MISSING_NATS)
                - (1.0 - 1.0 / MISSING_NATS) * np.log(p_value))
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def unknown_error(gap):
    """Standard deviation of `unknown_probability` by chance of the simulated records
    behind a p-value.
    """
    unknown = unknown_probability(gap.p_value)
    return unknown * (1.0 - unknown) * (1.0 - 1.0 / MISSING_NATS) * log_p_error(gap)


def all_causes(search, start, before, rest, staying):
    """All sets of effects, none among them, each alone and beside something unknown;
    most probable first.

    `rest` is the `Remainder` of the search, `staying` what of its path stays needed
    where the rest is described flexibly: more is not named beside unknown.
    """
    # what stands out only beside an added effect speaks against that effect
    gap = max(before, search.after, key=lambda gap: gap.p_value)
    unknown, off = unknown_probability(gap.p_value), unknown_error(gap)
    if any(r.opaque for r in start.readings) or rest.share < SLIGHT:
        unknown, off = min(unknown, PRIOR_UNKNOWN / MISSING_NATS), 0.0
    total, chance = sum(c.probability for c in search.leaves.values()), {}
    of_total = np.linalg.norm([c.error for c in search.leaves.values()])
    all_stay = search.path.found and len(staying) == len(search.path.found)
    for c in search.leaves.values():
        beside = c.found if all_stay else common(c.found, staying)
        for one, part in ((c, 1.0 - unknown), (c._replace(
                found=(*beside, Found(UNKNOWN))), unknown)):
            own = scaled(c._replace(error=np.hypot(
                c.error, c.probability / total * of_total)), part / total, off / total)
            known = chance.get(one.names, one._replace(probability=0.0, error=0.0))
            # the order in which they were found is that of the more probable way
            chance[one.names] = max(
                known, own._replace(found=one.found), key=lambda c: c.probability
            )._replace(probability=float(known.probability + own.probability),
                       error=float(np.hypot(known.error, own.error)))
    for c in (Cause((), 0.0, 0.0), Cause((Found(UNKNOWN),), 0.0, 0.0)):
        chance.setdefault(c.names, c)
    return tuple(sorted(chance.values(), key=lambda c: -c.probability))


def common(found, staying):
    """Those of some effects that stay; what else is found moves their values."""
    left, result = [(one.name, one.column) for one in staying], []
    for one in found:
        if (one.name, one.column) in left:
            left.remove((one.name, one.column))
            result.append(one)
    return tuple(result)


def present(causes):
    """Probability of every effect, in whatever company; of `none` that it is alone."""
    return {name: p for (name, number), p in _present(causes).items() if not number}


def _present(causes):
    """The same of effects as `_numbered`: of two steps the second is another."""
    result = {}
    for c in causes:
        for one in _numbered(c):
            result[one] = result.get(one, 0.0) + c.probability
    return result


def _numbered(cause):
    """(name, how many of that name are before it) of the effects of a cause."""
    effects = cause.effects or ("none",)
    return [(name, effects[:k].count(name)) for k, name in enumerate(effects)]


def _named(causes):
    """Effects, as in `_present`, of the first cause if it is more probable than not, or
    else every effect that is, in whatever company (the median probability model; M.
    Barbieri, J. Berger, "Optimal predictive model selection", Ann. Stat. 32, 2004), and
    beside those that are more probable, for each may stand for the other.
    """
    if causes[0].probability >= SURE:
        return _numbered(causes[0])
    chance, sure, all_of = _present(causes), [], 1.0
    for one in sorted(chance, key=chance.get, reverse=True):
        with_it = sum(c.probability for c in causes
                      if {*sure, one} <= {*_numbered(c)})
        if chance[one] >= SURE and with_it >= SURE * all_of:
            sure, all_of = [*sure, one], with_it
    return [one for one in chance if one in sure]


def split_families(causes):
    """(members, probability that any is there) of every family that is more probable
    than not, beside what is named, too, but none of whose members is named; of those,
    too, of which nearly all sets have one beside what is named, if anything is.
    """
    chance, named, result = present(causes), _named(causes), []
    sure = [name for name, _ in named]
    with_it = [c for c in causes if {*named} <= {*_numbered(c)}]
    beside, all_of = _present(with_it), sum(c.probability for c in with_it)

    def among(sets, some):
        return sum(c.probability for c in sets if {*_numbered(c)} & {*some})

    def more_probable(some):
        """Any of some effects than none, among all sets, and beside what is named."""
        return among(causes, some) >= SURE and among(with_it, some) >= SURE * all_of
    often = {one for one, p in beside.items() if p >= RARE * all_of}
    for family in FAMILIES:
        members = sorted((e for e in family if (e, 0) in often),
                         key=lambda e: -chance[e])
        every = [(name, 0) for name in family]    # of several, one is the first
        if len(members) > 1 and more_probable(every) and not set(family) & set(sure):
            result.append((tuple(members), among(causes, every)))
    nothing = {("none", 0), ("unknown", 0)}
    core = {*named} - nothing
    # with something unknown beside it, what is named is not all there is
    apart = {("none", 0)} if core and "unknown" not in sure else nothing
    alone = sum(c.probability for c in causes if {*_numbered(c)} - apart == core)
    if not result and alone < RARE * all_of:
        # of one name, the first that is not named
        rest = sorted((one for one in often - nothing if one[1] == sure.count(one[0])),
                      key=lambda e: (-beside[e], e))
        for count in range(2, len(rest) + 1):
            if more_probable(rest[:count]):
                return [(tuple(name for name, _ in rest[:count]),
                         among(causes, rest[:count]))]
    return result


def verdict_of(causes):
    """The effects that are named, and families that are split; as one."""
    sure = [name for name, _ in _named(causes)]
    if causes[0].probability >= SURE:
        return "+".join(sure)
    split = [" or ".join(members) for members, _ in split_families(causes)]
    return "+".join([*(e for e in sure if e != "unknown"), *split,
                     *(e for e in sure if e == "unknown")]) or "undecided"


def names_in(verdict):
    """The effects that a verdict names, members of a family each."""
    return verdict.replace(" or ", "+").split("+")


def names_all(verdict, found):
    """Are all that was found among what a verdict names? Where it names nothing that
    the catalogue has, they need not be.
    """
    return verdict in ("none", "unknown", "undecided") or all(
        one.name in names_in(verdict) for one in found)


def needed_duration(causes, scene):
    """Record length, s, at which the two best causes would be told apart, if their log
    odds grew as they did.
    """
    first, second = (c.probability for c in causes[:2])
    odds = max(np.log(first / max(second, 1e-12)), 0.5)
    return float(scene.duration * max(3.0 / odds, 1.0))
