"""Directed evidence: what one further signature of every family is worth, Eq. (11), and
the most probable signature of a family.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import probabilities, side_by_side
from sensorlab.gap.account import account
from sensorlab.gap.backward import solve
from sensorlab.gap.effects import BLOCK, Found, columns_of
from sensorlab.gap.evidence import Sample, effort, log_sum, normalized
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.linear import Signature
from sensorlab.gap.scans import FINER, family_bayes, is_coarse, refined, scores
from sensorlab.gap.signatures import SIZES, bayes_table, families, log_bayes

NODE_BLOCK = 8 * BLOCK    # samples of one record at many nodes that are worked on at a
                          # time; few leave lanes and cores idle
LEAST_NODES = 4           # at a time: for each such part all signatures are laid anew

NODES = 32            # of a posterior: its evidence is then good to 0.2 nat
MAX_ADDED = 3         # signatures whose posteriors give nodes
RESCUED = 15.0        # nats below the best, by which nodes of its own may lift one
MOST_GAINED = 2.0     # times what a scan tells, where a finer grid tells more
UNSEEN = 1e6          # times as uncertain as the surest: no sample shows it
MOST_NEAR = 4096      # signatures whose sizes are averaged
SLIGHT = 1e-3         # share of a hypothesis that need not be asked for a size


def nodes_for(scene):
    """Nodes that stand for a posterior: of a long record it is narrow."""
    return round(NODES * effort(scene))


def directed(scene, reference, listed, table=None, grids=None, least=0.0):
    """Of every hypothesis of an account without jumps a `Sample`: its evidence with no
    further signature, and with one of each family.

    Nodes come from its posterior and, where a signature moves that, from the one with
    it, which is asked of families that may be the best: importance sampling from their
    mixture. `table` is that of ln B, by default `bayes_table`; `grids` as for
    `estimate_signature`; what comes to less than the `least` ln B matters little.
    """
    table, latest, added = table or bayes_table(), reference, set()
    grids = {} if grids is None else grids
    scored, asked = [[] for _ in reference.hypotheses], range(1, len(listed) + 1)
    while True:
        for own, new in zip(scored, _scored(scene, reference, latest, listed, asked,
                                            table, grids, least)):
            own.append(new)
        samples = [_pooled(scene, own, past)
                   for own, past in zip(scored, reference.samples)]
        number = _ill_known(samples, 0.5 * nodes_for(scene), added)
        if not number or len(added) == MAX_ADDED:
            return samples
        added.add(number)
        asked = sorted({*asked} & _near_best(samples))
        signature, _ = estimate_signature(scene, reference, listed[number - 1], samples,
                                          number, grids, 1)
        latest = account(scene, reference.bases, reference.hypotheses,
                         (*reference.signatures, signature), past=reference)


class _Scored(NamedTuple):
    """A hypothesis at nodes of its posterior in an account."""

    theta: np.ndarray             # (M, p)
    log_likelihood: np.ndarray    # (M, 1 + F) with no further signature, with one of
                                  # each family; -inf where it was not asked for
    asked: tuple                  # (1 + F,) of bool: was it?
    hypothesis: object            # Member
    account: object               # Account
    log_evidence: float           # there


def _scored(scene, reference, latest, listed, asked, table, grids, least=0.0):
    """`_Scored` of all hypotheses at nodes of their posteriors in the latest account,
    with the families of the numbers that are `asked`, from 1; to `grids` are added
    those where they are resolved.
    """
    nodes = [_nodes(scene, latest, past) for past in latest.samples]
    most = max(NODE_BLOCK // len(scene.y), LEAST_NODES)
    parts = [(number, theta[begin:begin + most]) for number, theta in enumerate(nodes)
             for begin in range(0, len(theta), most)]
    # scans take longest: they begin; two of one kind would take the most memory
    order = sorted(asked, key=lambda k: listed[k - 1].psi is not None)
    found, likely = [[] for _ in nodes], {}    # of a long record a few nodes are a part
    low_pass = next((one.low_pass for one in listed if one.low_pass), None)
    for some in _together(parts, most):
        solved = side_by_side(lambda part: _for_scans(scene, solve(
            reference.hypotheses[part[0]], scene, reference.signatures, part[1],
            low_pass)), some)

        def told(jobs, known, finer=False):
            return dict(zip(jobs, side_by_side(
                lambda job: family_bayes(scene, listed[job[1] - 1], *solved[job[0]],
                                         table, known(*job), finer), jobs)))
        bayes = told(list(itertools.product(range(len(some)), order)),
                     lambda at, k: likely.get((some[at][0], k)))
        bayes |= told(_may_matter(bayes, [own.base for own, _ in solved], least),
                      lambda at, k: bayes[at, k][1], finer=True)
        for at, (number, _) in enumerate(some):
            base = solved[at][0].base
            ll = np.full((len(base), 1 + len(listed)), -np.inf)
            ll[:, 0] = base
            for k in order:
                ll[:, k] = base + bayes[at, k][0]
            found[number].append(ll)
            likely.update({(number, k): bayes[at, k][1] for k in order})
    for (_, k), one in likely.items():
        if one and one.grid:
            grids.setdefault(k, one.grid)
    known = tuple(k == 0 or k in order for k in range(1 + len(listed)))
    return [_Scored(theta, np.vstack(ll), known, h, latest, past.log_evidence[0])
            for theta, ll, h, past in zip(nodes, found, reference.hypotheses,
                                          latest.samples)]


def _may_matter(bayes, base, least):
    """Jobs, pairs of a part of the nodes and a family, of which a finer grid may tell
    more than that they are RESCUED nats below the best, or below the `least` that
    matters; their Bayes factors and `Likely` signatures by job, and log-likelihoods by
    part.
    """
    top = max(map(np.max, [*(own + max(least, 0.0) for own in base), *(
        base[at] + own for (at, _), (own, _) in bayes.items())]))
    return [(at, k) for (at, k), (own, likely) in bayes.items()
            if likely and likely.coarse and (base[at] + np.maximum(
                MOST_GAINED * own, own)).max() > top - RESCUED]


def _for_scans(scene, solved):
    """`Solved` of nodes, and of the likeliest, which scans are of: its steps alone are
    kept.
    """
    one = solved.node(int(solved.base.argmax())).for_scans(np.isnan(scene.y))
    several = solved if len(solved.base) > 1 else one
    return several._replace(steps=None, passed=None), one._replace(
        steps=one.steps.copy(), passed=one.passed.copy())


def _nodes(scene, latest, past):
    """Theta (M, p) that stands for a posterior of an account."""
    count = nodes_for(scene) if np.ptp(past.theta) else 1
    if past.log_evidence[0] < latest.samples[latest.best].log_evidence[0] - RESCUED:
        count = max(count // 8, 1)    # if a signature lifts it, that gives more nodes
    return past.nodes(count)


def _together(parts, most):
    """Lists of parts, one after another, of so many nodes at most."""
    some, nodes = [], 0
    for part in parts:
        if some and nodes + len(part[1]) > most:
            yield some
            some, nodes = [], 0
        some, nodes = [*some, part], nodes + len(part[1])
    yield some


def _pooled(scene, scored, past):
    """`Sample` of a hypothesis from its nodes; `past` is that of the reference."""
    none = past.log_evidence[0]
    theta = np.vstack([s.theta for s in scored])
    ll = np.vstack([s.log_likelihood for s in scored])
    # ln of the density of the mixture that the nodes are from, over that of the prior
    laws = np.array([
        np.log(len(s.theta)) - s.log_evidence + log_likelihoods(
            s.hypothesis, scene, s.account.signatures, theta) for s in scored])
    mixture = log_sum(laws, axis=0)
    fine = np.isfinite(mixture + ll[:, 0])    # at others a filter breaks down
    theta, ll, laws, mixture = theta[fine], ll[fine], laws[:, fine], mixture[fine]
    # families that were asked for at nodes of few laws have these alone
    times = np.sum([s.asked for s in scored], axis=0)
    for few in set(times.tolist()) - {len(scored)}:
        ll[:, times == few] += (mixture - log_sum(laws[:few], axis=0))[:, None]
    return Sample(theta, None, -mixture, ll, np.append(
        none, log_sum(ll[:, 1:] - mixture[:, None], axis=0)))


def _near_best(samples):
    """Numbers of the families that may be the best."""
    evidence = np.array([s.log_evidence for s in samples])
    return {*(1 + np.flatnonzero(evidence[:, 1:].max(0) > evidence.max() - RESCUED))}


def _ill_known(samples, enough, added):
    """Number of a family not added yet that is the best of a hypothesis, may be the
    best of all, and has not enough effective nodes there; 0 if there is none.
    """
    top, result, height = max(s.log_evidence.max() for s in samples), 0, -np.inf
    for s in samples:
        best = int(s.log_evidence.argmax())
        w = normalized(s.log_weight + s.log_likelihood[:, best])
        if best and best not in added and 1.0 / np.sum(w**2) < min(enough, len(w)) and (
                s.log_evidence[best] > max(top - RESCUED, height)):
            result, height = best, s.log_evidence[best]
    return result


class _Sizes(NamedTuple):
    """Posterior of the size of signatures near the best: nodes, psi, prior variances.
    """

    mass: np.ndarray      # (M, m, v)
    mean: np.ndarray      # (M, m, v)
    second: np.ndarray    # (M, m, v) moment
    psi: np.ndarray       # (m, d)
    variant: np.ndarray   # (m,)


def estimate_signature(scene, reference, family, samples, number, grids=None,
                       count=None):
    """The most probable signature of a family, as a `Signature` and as a `Found` whose
    values are (mean, sd).

    `number` is that of the family in the evidence of the samples. Moments are over
    hypotheses, `count` nodes of each, psi and prior variances of the size. `grids` are
    those where families have been resolved, by number: it begins there, and others,
    that it leaves its own.
    """
    count, grids = count or nodes_for(scene) // 2, {} if grids is None else grids
    shares = probabilities([s.log_evidence[number] for s in samples])
    own = [one for one in zip(reference.hypotheses, samples, shares)
           if one[2] > SLIGHT]

    def sizes(one):
        h, sample, share = one
        return _sizes(h, scene, reference.signatures, family, sample.nodes(
            count, number), share, grids.get(number))
    most = max(own, key=lambda one: one[2])
    first, grids[number] = sizes(most)    # where the others begin
    return _of_sizes(scene, family, [first, *(piece for piece, _ in side_by_side(
        sizes, [one for one in own if one is not most]))])


def estimated_beside(scene, h, signatures, one, theta):
    """Values (mean, sd) by symbol of a `Signature` beside others, of a hypothesis at
    nodes theta (M, p) that are as probable each: of its size, too, over all that its
    other parameters may be.
    """
    found = one.found
    family = next(family for family in families(scene, [found.effect])
                  if family.column == found.column)._replace(
        variant=found.variant, low_pass=found.low_pass)
    about = FINER.get(found.effect.search)
    grid = about and about[0](scene, family, *(
        found.values[p.symbol] for p in found.effect.parameters(scene)))
    piece, _ = _sizes(h, scene, signatures, family, theta, 1.0, grid)
    return _of_sizes(scene, family, [piece])[1].values


def _of_sizes(scene, family, pieces):
    """The most probable signature of a family, as for `estimate_signature`, from
    `_Sizes`, which have a share of the probability each.
    """
    best = max(pieces, key=lambda p: p.mass.sum((0, 2)).max())
    at = best.mass.sum((0, 2)).argmax()
    psi, variant = best.psi[at].tolist(), str(best.variant[at])
    # the sizes of different variants have different units
    pieces = [(p.mass[:, own], p.mean[:, own], p.second[:, own], p.psi[own])
              for p in pieces for own in [p.variant == variant]]
    total = sum(p[0].sum() for p in pieces)

    def expected(part):
        return float(sum((p[0] * part(p)).sum() for p in pieces) / total)
    effect, values = family.effect, {}
    for k, p in enumerate(effect.parameters(scene)):
        mean = expected(lambda p: p[3][:, k, None])
        variance = expected(lambda p: (p[3][:, k, None] - mean)**2)
        if effect.search in ("onset", "pulse") and _are_whole(scene, pieces, k):
            variance += scene.dt**2 / 3.0    # anywhere since the sample before
        values[p.symbol] = mean, float(np.sqrt(variance))
    size = expected(lambda p: p[1])
    sd = float(np.sqrt(max(expected(lambda p: p[2]) - size**2, 0.0)))
    values[effect.size] = size, sd
    found = Found(effect, family.column, variant, values, float(total),
                  low_pass=family.low_pass)
    numbers = {**dict(zip(values, psi)), effect.size: size}
    return Signature(found._replace(values=numbers), columns_of(scene, found, numbers),
                     3.0 * float(np.hypot(size, sd))), found


def _are_whole(scene, pieces, k):
    """Are the values of a parameter whole samples?"""
    samples = np.concatenate([psi[:, k] for *_, psi in pieces]) / scene.dt
    return np.abs(samples - np.round(samples)).max() < 1e-6


def onsets_nearby(scene, one, most):
    """The `Signature` itself, where it lies among those with onsets up to so many
    samples away; alone, if it has no onset.
    """
    effect, values = one.found.effect, one.found.values
    low, high = next(((p.low, p.high) for p in effect.parameters(scene)
                      if p.symbol == "onset"), (0.0, 0.0))
    result = []
    for away in range(-most, most + 1):
        onset = values.get("onset", 0.0) + away * scene.dt
        if away == 0:
            result.append(one)
        elif low < onset < high:
            moved = {**values, "onset": onset}
            result.append(one._replace(
                found=one.found._replace(values=moved),
                columns=columns_of(scene, one.found, moved)))
    return result


AROUND = 4000    # samples to either side of an onset, which tell where it is nearby


def part_about(scene, one):
    """The part of a scene, a slice, about the onset of a `Signature`."""
    at = round(one.found.values["onset"] / scene.dt)
    return slice(max(at - AROUND, 0), at + AROUND)


def _sizes(h, scene, signatures, family, theta, share, grid):
    """`_Sizes` of a hypothesis of a given share at some nodes, and the `Grid` that they
    are from, if there is one; `grid` is another that is near.
    """
    theta, times = np.unique(theta, axis=0, return_counts=True)
    if is_coarse(scene, family):
        one = solve(h, scene, signatures, theta[times.argmax()][None], family.low_pass
                    ).for_scans(np.isnan(scene.y))
        family, grid = refined(scene, family, one, grid)
    found = scores(scene, family, solve(h, scene, signatures, theta, family.low_pass))
    best, sd = found.gain.max(0), found.sd.min(0)
    near = np.flatnonzero((best > best.max() - 60.0) & (sd < UNSEEN * sd.min()))
    if len(near) > MOST_NEAR:    # nothing stands out of so many
        near = np.sort(near[np.argsort(-best[near], kind="stable")[:MOST_NEAR]])
    each = log_bayes(found.gain[:, near], found.k)
    if family.effect.search in FINER:    # even in ln of the duration, not in the end
        each -= np.log(found.psi[near, 1, None])
    mass = np.exp(each - logsumexp(each, axis=(1, 2), keepdims=True))
    # moments along the estimate of the normal law times its squared size
    shrink = SIZES / (1.0 + SIZES)
    k, square = found.k, (found.size[:, near, None] * shrink)**2
    variance = found.sd[:, near, None]**2 * shrink
    mean = found.size[:, near, None] * shrink * (
        (square + (k + 2) * variance) / (square + k * variance))
    second = (square**2 + (k + 5) * square * variance + (k + 2) * variance**2) / (
        square + k * variance)
    variant = np.array(found.variant or [""] * len(found.psi))
    return _Sizes(mass * share * (times / times.sum())[:, None, None], mean, second,
                  found.psi[near].reshape(len(near), -1), variant[near]), grid
