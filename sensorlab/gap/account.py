"""An account: what a record is explained by, and the simulator that this implies."""

import functools
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import binom

from sensorid import Parameter, brief, free_columns, probabilities, side_by_side
from sensorlab.gap.effects import Effect, Found, Simulator, known_values, signature_of
from sensorlab.gap.evidence import effort, integrate, log_sum, onset_law
from sensorlab.gap.filters import estimated, log_likelihoods, part_of, predict, solve
from sensorlab.gap.mixtures import smoothed
from sensorlab.gap.processes import beside, join
from sensorlab.gap.screens import (
    LAWS, STRENGTHS, change_of_drive, noise_with, usual_variance)
from sensorlab.gap.spectra import posterior_law


class Account(NamedTuple):
    """What a record is explained by."""

    bases: tuple         # of Member: the simulator as it was
    hypotheses: tuple    # of Member: the same with effects that were found
    signatures: tuple    # of Signature
    readings: tuple      # of Reading
    samples: tuple       # of Sample, one of every hypothesis
    log_evidence: float
    best: int            # number of the most probable hypothesis
    theta: np.ndarray    # (p,) parameters that stand for its posterior

    __repr__ = brief

    @property
    def member(self):
        """The most probable hypothesis."""
        return self.hypotheses[self.best]

    @property
    def sample(self):
        """Of the most probable hypothesis."""
        return self.samples[self.best]

    @property
    def error(self):
        """Standard deviation of the log evidence by chance of the nodes, nats."""
        return evidence_error(self.samples)

    @property
    def peak(self):
        """Largest log-likelihood that any hypothesis reaches."""
        return max(s.log_likelihood.max() for s in self.samples)


def account(scene, bases, hypotheses=None, signatures=(), readings=(), past=None,
            floor=-np.inf, tails=0):
    """Fit of all hypotheses to a scene, with equal prior probabilities.

    `past` is another account of about the same record, if there is one; `floor` and
    `tails` as for `integrate`.
    """
    hypotheses = bases if hypotheses is None else hypotheses

    def likelihood_of(h):
        return lambda theta: log_likelihoods(h, scene, signatures, theta)[:, None]
    guesses = side_by_side(lambda number: guesses_from(
        past, number, hypotheses[number], scene, signatures) if past else (),
        range(len(hypotheses)))
    samples, evidence = [None] * len(hypotheses), np.full(len(hypotheses), -np.inf)
    past_evidence = [s.log_evidence[0] for s in past.samples] if past else evidence
    for number in np.argsort(past_evidence, kind="stable")[::-1]:
        h = hypotheses[number]
        samples[number] = integrate(
            likelihood_of(h), h.parameters, guesses[number],
            onset_law(h, scene, signatures), max(floor, evidence.max()),
            effort=effort(scene), tails=tails)
        evidence[number] = samples[number].log_evidence[0]
    best = int(np.argmax(evidence))
    return Account(tuple(bases), tuple(hypotheses), tuple(signatures), tuple(readings),
                   tuple(samples), mean_evidence(evidence) + sum(
                       s.gain for s in signatures), best,
                   central(samples[best], likelihood_of(hypotheses[best])))


TAILS = 8    # rounds


def with_tails(scene, acc):
    """The account of a scene, its posterior known far out, too; of a long record it is
    narrow.
    """
    if effort(scene) < 1.0:
        return acc
    return account(scene, acc.bases, acc.hypotheses, acc.signatures, acc.readings, acc,
                   tails=TAILS)


def central(sample, log_likelihood):
    """Posterior mean, or the most likely node where the posterior is bent around it:
    there the mean is less likely than a node is on average.
    """
    mean, ll = sample.mean, sample.log_likelihood[:, 0]
    if log_likelihood(mean[None])[0, 0] >= sample.weight @ ll:
        return mean
    return sample.likeliest


def guesses_from(past, number, h, scene, signatures):
    """Pairs of mean (d,) and covariance (d, d) that the free parameters of a hypothesis
    may have in the coordinates of `integrate`: as they were, or as spectra tell.
    """
    other, sample = past.hypotheses[number], past.samples[number]
    keys = [h.keys[c] for c in free_columns(h.parameters)]
    if not keys:
        return ()
    before = free_columns(other.parameters)
    known = {other.keys[b]: axis for axis, b in enumerate(before) if any(
        key == other.keys[b] and _is_same(p, other.parameters[b])
        for key, p in zip(h.keys, h.parameters))}
    mean, cov = sample.law if before else (np.zeros(0), np.zeros((0, 0)))
    axes = list(known.values())
    kept = _spread(keys, list(known), mean[axes], cov[np.ix_(axes, axes)])
    result = [kept] if known else []
    for one in h.effects:
        if one.effect.relative_to and one.key not in [own.key for own in other.effects]:
            return [*result, _louder_with(one, h, keys, scene, signatures, other,
                                          sample, kept)]
        if (one.key, "factor") in keys and (one.key, "factor") not in known:
            return [*result, _scaled(one, h, keys, scene, signatures, other)]
    driven = h.driven
    if driven and driven.key not in [one.key for one in other.effects]:
        return [*result, _before_change(h, keys, scene, signatures, other, sample)]
    changed = [(one.key, symbol) for one in h.effects if one.effect.search == "onset"
               for symbol in one.values]    # a spectrum tells nothing of these
    if not set(keys) & set(changed) <= set(known) or (
            len(keys) == len(known) == len(before)
            and len(signatures) == len(past.signatures)):
        return result
    # where what is new is weak, all else is as it was; where not, its spectrum tells
    theta = sample.likeliest
    twin, its_other = _as_processes(h), _as_processes(other)
    odd, law = _odd(h, scene, signatures, other, theta)
    told = posterior_law(
        twin, scene._replace(y=np.where(odd > 0.5, np.nan, scene.y)), signatures,
        its_other, other.matching(its_other, theta),
        {key: mean[axis] for key, axis in known.items()})
    free = [twin.keys[c] for c in free_columns(twin.parameters)]
    of = [axis for axis, key in enumerate(free) if key not in changed]
    mean, cov = told
    return [*result, _spread(keys, [free[axis] for axis in of], mean[of], cov[np.ix_(
        of, of)], _spread(keys, *law, kept))]


def _before_change(h, keys, scene, signatures, other, sample):
    """The law of the free parameters `keys` of a hypothesis whose states are driven
    differently from some sample on: what the record up to there tells another, which
    has no such change.
    """
    change = change_of_drive(
        h.driven.effect, scene, other, signatures,
        sample.likeliest)
    early, known = part_of(scene, signatures, slice(change.onset))
    free = [other.keys[c] for c in free_columns(other.parameters)]
    told = integrate(
        lambda theta: log_likelihoods(other, early, known, theta)[:, None],
        other.parameters, effort=effort(scene)).law if free else (
        np.zeros(0), np.zeros((0, 0)))
    ratio, x = (h.driven.key, "ratio"), ndtri(change.quantile)
    near = np.array([x]), np.array([[np.exp(x * x) * 2.0 * np.pi / STRENGTHS**2]])
    return _spread(keys, free, *told, _spread(keys, [ratio], *near)
                   if ratio in keys else None)


def _louder_with(one, h, keys, scene, signatures, other, sample, kept):
    """The law of the free parameters `keys` of a hypothesis in which an effect makes
    the white noise follow a column, or the time: what the scores of another tell, which
    has no such effect, all else as `kept`.
    """
    seen = predict(other, scene, signatures, sample.likeliest[None])
    told = noise_with(scene, one, seen.z[0, 0])
    likeliest = dict(zip(other.keys, sample.likeliest))
    own = {(one.key, "ratio"): (told.ratio, told.off)}
    own.update((key, (told.rest * likeliest[key], told.off)) for key in keys
               if key[1] == "sigma_v" and key in likeliest)
    return _near_values(own, h, keys, kept)


def _near_values(own, h, keys, rest=None):
    """The law of the free parameters `keys` of a hypothesis, of which some are near
    values that are known, pairs of that and of how well its logarithm is, by key; the
    rest as for `_spread`.
    """
    priors = dict(zip(h.keys, h.parameters))
    near = np.array([[_coordinate(priors[key], value * np.exp(step * off))
                      for step in (-1.0, 0.0, 1.0)]
                     for key, (value, off) in own.items()])
    return _spread(keys, list(own), near[:, 1], np.diag(
        (0.5 * (near[:, 2] - near[:, 0]))**2 + NARROWEST**2), rest)


def _scaled(one, h, keys, scene, signatures, other):
    """The law of the free parameters `keys` of a hypothesis in which one factor is on
    all standard deviations: what the scores of another have in the middle of its prior,
    all else as in that.
    """
    middle = np.array([[p.mean for p in other.parameters]])
    z = predict(other, scene, signatures, middle).z[0, 0]
    return _near_values({(one.key, "factor"): (np.sqrt(np.nanmean(z**2)), SCALED)}, h,
                        keys)


SCALED = np.log(2.0)    # of a factor, by how much it may be another elsewhere in the
                        # prior
COORDINATES = np.linspace(-4.0, 4.0, 801)    # of a prior
NARROWEST = 0.01    # standard deviation of one, of a law from which nodes are moved


def _coordinate(prior, value):
    """Where a prior that is N(0, 1) has a value; about, and not far out."""
    return np.interp(value, prior.quantile(ndtr(COORDINATES)), COORDINATES)


def _spread(keys, own, mean, cov, rest=None):
    """The law of some parameters as one of all of them, independent of those of the
    rest, which are as in the law `rest`, or standard normal.
    """
    whole, square = (np.zeros(len(keys)), np.eye(len(keys))) if rest is None else (
        part.copy() for part in rest)
    at = [keys.index(key) for key in own]
    whole[at] = mean
    square[at], square[:, at] = 0.0, 0.0
    square[np.ix_(at, at)] = cov
    return whole, square


@functools.cache
def _as_process(effect):
    """A level of two values, or one that steps, as a process of its covariance."""
    def model(scene, filt, **values):
        jumps = effect.jumps(scene.dt, **values)
        if np.any(jumps.step):
            return _steps_as_walk(scene, filt, jumps.sigma_w)
        return _level_as_noise(scene, filt, jumps.begin, jumps.half)
    return effect._replace(model=model, jumps=None, elementwise=True)


def _as_processes(h):
    """A hypothesis without outliers and bursts, its levels as processes."""
    return h._replace(effects=tuple(
        one._replace(effect=_as_process(one.effect)) if one.effect.jumps else one
        for one in h.effects if one.name not in LAWS))


def _odd(h, scene, signatures, other, theta):
    """Probability (N,) that samples are outliers, or in a burst, if a hypothesis has
    such; keys, mean and covariance of their free parameters if another, which is at
    theta (p,), has none.
    """
    nothing = (), np.zeros(0), np.zeros((0, 0))
    known = [one.key for one in other.effects]
    odd, own = np.zeros(len(scene.y)), [one for one in h.effects if one.name in LAWS]
    if not own:
        return odd, nothing
    seen = predict(other, scene, signatures, theta[None])
    if other.has_jumps:
        odd = _unless_most(_not_usual(other, seen, theta))
    z = np.where(odd > 0.5, np.nan, seen.z[0, 0])
    variance, new = usual_variance(z, seen.log_score[0, 0]), [
        one for one in own if one.key not in known]
    if np.isnan(variance) or not new:
        return odd, nothing
    (one,) = new
    more, mean, cov = LAWS[one.name](scene, one.effect, z, variance)
    free = [axis for axis, p in enumerate(one.values.values()) if p.free]
    return np.maximum(odd, _unless_most(more)), (
        [(one.key, list(one.values)[axis]) for axis in free],
        np.asarray(mean)[free], np.asarray(cov)[np.ix_(free, free)])


def _unless_most(odd):
    """Probabilities (N,) that samples are odd; 0 if most are: the rest would tell too
    little.
    """
    return odd if np.mean(odd > 0.5) <= 0.5 else np.zeros(len(odd))


def _not_usual(h, seen, theta):
    """Probability (N,) that samples are outliers or in a burst, of a hypothesis with
    jumps at theta (p,).
    """
    jumps, odd = h.jumps(theta[None]), np.nan_to_num(seen.odd[0, 0])
    return np.maximum(odd, _on_second(seen, jumps)) if jumps.louder[0] else odd


def _on_second(seen, jumps):
    """Probability (N,) that samples have the second level, by all of them."""
    return smoothed(seen.second[0, 0], jumps.begin[0], jumps.end[0])


def _is_same(p, q):
    """Are two priors one, so that their coordinates are?"""
    return p is q or type(p) is type(q) is Parameter and p == q


def mean_evidence(log_evidence):
    """Log of the mean over hypotheses of equal prior probability."""
    return float(log_sum(log_evidence) - np.log(len(log_evidence)))


def evidence_error(samples, number=0):
    """Standard deviation, nats, of the mean evidence of explanation `number` over
    hypotheses by chance of their nodes.
    """
    share = probabilities([s.log_evidence[number] for s in samples])
    return float(np.linalg.norm([part * s.error[number]
                                 for part, s in zip(share, samples)]))


def fixed(**values):
    """Values of an effect as parameters that are known."""
    return {symbol: Parameter(symbol, float(v), float(v))
            for symbol, v in values.items()}


def _level_as_noise(scene, filt, change, half):
    return beside(filt, [1.0 - 2.0 * change], [half])


def _steps_as_walk(scene, filt, sigma_w):
    return join(filt, (1.0, sigma_w, 0.0))


def _louder_at_times(scene, filt, variance, share):
    return filt._replace(Psi=np.sqrt(filt.Psi**2 + share * variance))


LEVEL_AS_NOISE = Effect("level_as_noise", model=_level_as_noise, elementwise=True)
STEPS_AS_WALK = Effect("steps_as_walk", model=_steps_as_walk, elementwise=True)


def _louder(share):
    """The effect of a noise that is there with a probability (N,)."""
    always, on_average = (functools.partial(_louder_at_times, share=part)
                          for part in (share, share.mean()))
    return Effect("louder_at_times", model=always, on_average=on_average,
                  elementwise=True, comes_last=True)


def gaussian(scene, acc):
    """Scene and hypotheses without jumps: sure outliers are masked, a level of two
    values becomes the Markov process of its covariance, steps become a walk, bursts a
    variance at their times.
    """
    if not acc.member.has_jumps:
        return scene, acc.hypotheses
    seen = predict(acc.member, scene, acc.signatures, acc.theta[None])
    masked = scene._replace(y=np.where(seen.odd[0, 0] > 0.5, np.nan, scene.y))
    plain, own = [], acc.member.jumps(acc.theta[None])
    louder = _louder(_on_second(seen, own)) if own.louder[0] else None
    for h in acc.hypotheses:    # one that cannot be may not know what jumps
        effects = tuple(one for one in h.effects if not one.effect.jumps)
        if own.half[0] > 0.0:
            effects += (Found(LEVEL_AS_NOISE, values=fixed(change=own.begin[0],
                                                           half=own.half[0])),)
        if own.step[0] > 0.0:
            effects += (Found(STEPS_AS_WALK, values=fixed(sigma_w=own.sigma_w[0])),)
        if louder:
            effects += (Found(louder, values=fixed(variance=own.louder[0])),)
        plain.append(h._replace(effects=effects))
    return masked, tuple(plain)


CLUSTER = 16         # samples, in which outliers may come together
BY_CHANCE = 1e-3    # that as many do somewhere in a record
SURE = 0.98         # which of two levels a sample has
MOSTLY = 0.95       # of the samples, if the level is known


def for_signatures(scene, acc, stand_in):
    """Scene and hypotheses without jumps in which signatures are sought: those that
    `gaussian` gives, but outliers in clusters that independent ones do not make are
    back: a signature may explain all of them at once.
    """
    plain, hypotheses = stand_in
    if plain is not scene:
        plain = _with_clusters(scene, plain, acc.member.jumps(acc.theta[None]).rate[0])
    return plain, hypotheses


def for_processes(scene, acc, stand_in):
    """Scene and hypotheses without jumps in which processes are sought: those that
    `gaussian` gives, but a level that is known is taken away.

    Where it is taken for the other one, that looks like a pulse, but like no process.
    """
    plain, hypotheses = stand_in
    jumps = acc.member.jumps(acc.theta[None])
    if not jumps.half[0]:
        return plain, hypotheses
    seen = predict(acc.member, scene, acc.signatures, acc.theta[None])
    second = _on_second(seen, jumps)
    known = np.maximum(second, 1.0 - second) > SURE
    if known.mean() < MOSTLY:
        return plain, hypotheses
    level = np.where(known, jumps.half[0] * np.sign(second - 0.5), np.nan)
    return plain._replace(y=plain.y - level), tuple(h._replace(effects=tuple(
        one for one in h.effects if one.effect is not LEVEL_AS_NOISE))
        for h in hypotheses)


def _with_clusters(scene, masked, rate):
    """A scene with samples back that are masked as outliers of a rate."""
    window, odd = np.ones(CLUSTER), np.isnan(masked.y) & ~np.isnan(scene.y)
    many = np.convolve(odd, window, "same") > binom.isf(
        BY_CHANCE / len(odd), CLUSTER, rate)
    near = np.convolve(many, window, "same") > 0.5
    return masked._replace(y=np.where(near, scene.y, masked.y))


def as_simulated(acc, scene, theta, widths=None):
    """The most probable hypothesis of an account, and its effects, with numbers for
    parameters, as a `Simulator`; of several theta (M, p), all are equally probable.

    `widths` (p,) turns them into ranges theta -+ width, but for when something begins.
    Of a record that is clipped the bias counts, as the limits stand still: it is that
    of the scene.
    """
    thetas = np.atleast_2d(theta)
    sized = with_sizes(acc, scene, thetas)
    return Simulator(*zip(*(_with_numbers(acc, one, widths, own)
                            for one, own in zip(thetas, sized))))


def _ones(scene, x, psi):
    return [("", np.ones((len(scene.y), 1)))]


LEVEL = Effect("level", columns=_ones)


def in_place(simulator, acc, scene):
    """The simulator of an account with a constant, so that its records lie where that
    of the scene does, of which the mean was taken off: what coarse counts or limits do
    hangs on it, and signatures have a mean of their own.
    """
    if not (any(r.placed for r in acc.readings) and acc.signatures
            and acc.bases[acc.best].bias_sigma):    # without, it lies where it does
        return simulator
    seen, effects = ~np.isnan(scene.y), []
    for own in simulator.effects:
        mean = sum(np.mean(signature_of(scene, one, known_values(one))[seen])
                   for one in own if one.effect.columns)
        effects.append((*own, Found(LEVEL, values=dict(size=-mean))))
    return simulator._replace(effects=tuple(effects))


def _with_numbers(acc, theta, widths, sized):
    """The hypothesis and the effects of `as_simulated` at one theta (p,)."""
    base = acc.bases[acc.best].hypothesis
    placed = any(r.placed for r in acc.readings)
    widths = np.zeros(len(theta)) if widths is None else widths
    scaled = acc.member.in_units(theta)
    h = base._replace(bias_sigma=0.0 if placed else base.bias_sigma, parameters=tuple(
        around(p, v, w) for p, v, w in zip(base.parameters, scaled, widths)))
    for one in acc.member.effects:
        if one.effect.factor:    # what makes a bias larger is in the base already
            h = h._replace(bias_sigma=h.bias_sigma * min(
                acc.member.value(theta, one.key, "factor"), 1.0))
    known = {key: around(p, v, w if key not in acc.member.onsets else 0.0)
             for key, p, v, w in zip(acc.member.keys, acc.member.parameters, scaled,
                                     widths)}
    inside = [one._replace(values={symbol: known[one.key, symbol]
                                   for symbol in one.values})
              for one in acc.member.effects
              if not (one.effect.reading or one.effect.factor)]
    return h, (*inside, *sized, *(r.found for r in acc.readings if r.does_something))


SAME = 1e-12    # relative: a number of which weights have made a mean


def around(p, value, width):
    """A parameter known to +- width, within its prior if the value is."""
    if not p.free and np.isclose(value, p.low, rtol=SAME, atol=0.0):
        return p    # but for rounding
    low = max(value - width, p.low) if value >= p.low else value
    high = min(value + width, p.high) if value <= p.high else value
    return Parameter(p.symbol, low, high)


def with_sizes(acc, scene, thetas):
    """Lists of the signatures of an account, as `Found`, with their least-squares sizes
    at each theta.
    """
    if not acc.signatures:
        return [[]] * len(thetas)
    masked, hypotheses = gaussian(scene, acc)
    plain = hypotheses[acc.best]
    at = np.array([acc.member.matching(plain, theta) for theta in thetas])
    return [_sized(acc.signatures, iter(sizes)) for sizes in estimated(
        plain, masked, acc.signatures, at).size[0]]


def solved_by(acc, scene):
    """`Solved` of the most probable hypothesis of an account, at its theta; of what
    stands in for jumps, where it has some.
    """
    plain, hypotheses = gaussian(scene, acc)
    h = hypotheses[acc.best]
    return solve(h, plain, acc.signatures, acc.member.matching(h, acc.theta)[None])


def bias_of(acc, scene):
    """Expectation and standard deviation of the bias of a record, u."""
    masked, hypotheses = gaussian(scene, acc)
    plain = hypotheses[acc.best]
    told = estimated(plain, masked, acc.signatures,
                     acc.member.matching(plain, acc.theta)[None])
    return float(told.size[0, 0, -1]), float(np.sqrt(told.covariance[0, 0, -1, -1]))


def _sized(signatures, sizes):
    """Signatures as `Found` with the sizes of their columns, one after another."""
    result = []
    for s in signatures:
        size = np.array([next(sizes) for _ in range(s.columns.shape[1])])
        if s.is_held:
            norm = max(np.hypot(*size), 1e-300)
            size *= np.clip(norm, *s.held) / norm
        values = {**s.found.values, s.found.effect.size: np.hypot(*size)
                  if len(size) == 2 else size[0]}
        if len(size) == 2:
            values["phase"] = np.arctan2(-size[1], size[0])
        result.append(s.found._replace(values=fixed(**values)))
    return result
