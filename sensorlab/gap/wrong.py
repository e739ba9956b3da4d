"""A parameter of the simulator that is itself wrong: it lies outside its range."""

from typing import NamedTuple

import numpy as np
from scipy.special import ive, logsumexp

from sensorid import middles
from sensorlab.gap.account import account
from sensorlab.gap.effects import Found
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.rival import Rival, different, log_bayes_over, values_of
from sensorlab.gap.standins import solved_by


class Beyond(NamedTuple):
    """Prior of a parameter outside a range: its logarithm is an e-fold beyond the
    nearer end on average, by an exponential law.
    """

    symbol: str
    low: float      # where the law is cut off
    high: float
    least: float    # ends of the range
    most: float
    free = log = True

    def quantile(self, u):
        """Value below which the prior has the probability u, 0..1."""
        u = np.asarray(u)
        share = 0.5 if self.least > 0.0 else 0.0    # below the range; none below zero
        below = np.minimum(u / share, 1.0) if share else 1.0
        above = np.minimum((1.0 - u) / (1.0 - share), 1.0)
        above = np.maximum(above, self.most / self.high)
        return np.clip(np.where(u < share, self.least * below, self.most / above),
                       self.low, self.high)

    @property
    def mean(self):
        return 0.5 * (self.least + self.most)

    @property
    def sd(self):
        return self.most


def with_wrong_parameters(scene, acc, effect, floor):
    """Rivals in which one parameter of the simulator may leave its bounds; if it is of
    an effect that has several forms, in any of them.

    A range is left alone unless the record pushes against one of its ends, or something
    outside is much better.
    """
    for key in dict.fromkeys(key for base in acc.bases for key in base.keys):
        widened = [_widened(h, sample, key, effect.factor, scene, acc.signatures)
                   for h, sample in zip(acc.hypotheses, acc.samples)]
        if not any(pushed for _, pushed in widened):
            continue
        name, (own, _) = ".".join(filter(None, key)), key
        its_own = form_of(acc.bases, own)
        for form, members in different((form, [
                h.with_form(own, form) for h, _ in widened])
                for form in _forms(acc.bases, own)):
            wide = account(scene, acc.bases, members, acc.signatures, acc.readings, acc,
                           floor)
            other = {} if form == its_own else dict(form=(form, 0.0))
            yield Rival(effect, name, log_bayes_over(wide, acc), account=wide,
                         values=dict(parameter=(name, 0.0), **other,
                                     factor=factor_of(key, acc.hypotheses, wide)))


SPREAD, STEPS = 8.0, 321    # standard errors about an amplitude, and in how many steps


def with_wrong_sizes(scene, acc, effect):
    """Rivals in which the amplitude of a line of the simulator, of any phase, is not
    within its ends.

    Of a line of amplitude A the estimate (2,) has Rice's law about it: with its length
    r and variance c^2 the likelihood is exp(-(A - r)^2 / 2 c^2) I_0(A r / c^2)
    exp(-A r / c^2).
    """
    for number, s in enumerate(acc.signatures):
        if not s.is_held:
            continue
        solved = solved_by(acc, scene)
        first = 1 + sum(other.columns.shape[1] for other in acc.signatures[:number])
        own = slice(first, first + 2)
        # less what the prior of the filter says
        precision = 1.0 / np.mean(np.diag(solved.cov[0])[own]) - 1.0 / s.sd**2
        if not precision > 0.0:
            continue
        c = precision**-0.5
        r = np.hypot(*solved.size[0, own]) * (1.0 + c**2 / s.sd**2)

        def rice(A, r=r, c=c):
            return -0.5 * ((A - r) / c)**2 + np.log(ive(0, A * r / c**2))
        least, most = s.held
        within = logsumexp(rice(np.linspace(least, most, STEPS))) - np.log(STEPS)
        A, apart = np.linspace(max(r - SPREAD * c, 1e-3 * c), r + SPREAD * c, STEPS,
                               retstep=True)
        # beyond, an e-fold on average, as other parameters
        beyond = rice(A) + np.log(0.5 * apart * np.where(
            A > most, most / A**2, np.where(A < least, 1.0 / least, 0.0)) + 1e-300)
        gain = float(logsumexp(beyond) - within)
        if gain <= 0.0:
            continue
        w = np.exp(beyond - beyond.max())
        factor = A / _reference(A, least, most, 0.5 * (least + most))
        mean = w @ factor / w.sum()
        name = f"{s.found.name}.{s.found.effect.size}"
        loose = (*acc.signatures[:number], s._replace(gain=gain),
                 *acc.signatures[number + 1:])
        yield Rival(effect, name, gain, account=acc._replace(
            signatures=loose, log_evidence=acc.log_evidence + gain), values=dict(
                parameter=(name, 0.0), factor=(float(mean), float(np.sqrt(
                    w @ (factor - mean)**2 / w.sum())))))


def form_of(bases, key):
    """Which form of an effect, by its key, a simulator has; "" if there is but one."""
    return next((one.variant or one.effect.variants[0] for base in bases
                 for one in base.effects if one.key == key and one.effect.variants), "")


def _forms(bases, key):
    """The form of an effect that a simulator has, then all others."""
    own = form_of(bases, key)
    others = next((base.forms(one.effect) for base in bases for one in base.effects
                   if one.key == key), ())
    return (own, *(form for form in others if form != own))


ALL = "all"    # standard deviations, by one factor


def is_single(one):
    """Is it a single parameter that is wrong?"""
    return one.effect.factor and one.values["parameter"][0] != ALL


def held_by(signatures, one):
    """The line of the simulator whose amplitude is wrong, if it is that, in a list."""
    return [s for s in signatures if one.effect.factor and s.gain and one.values.get(
        "parameter", ("",))[0] == f"{s.found.name}.{s.found.effect.size}"][:1]


def wrong_key(one):
    """Key (effect, symbol) of the single parameter that is wrong; "" is no effect."""
    effect, _, symbol = one.values["parameter"][0].rpartition(".")
    return effect, symbol


def with_wrong_scale(scene, acc, effect, floor):
    """The rival in which one factor, wrong units say, is on all standard deviations, if
    there are several of which the record pushes against one.
    """
    if any(one.effect.factor for one in acc.member.effects) or any(
            isinstance(p, Beyond) and p.symbol.startswith("sigma")
            for p in acc.member.parameters):
        return
    columns = [[c for c, (_, symbol) in enumerate(h.keys) if symbol.startswith("sigma")]
               for h in acc.hypotheses]
    if max(map(len, columns)) < 2 or not any(
            _pushed(h.parameters[c], sample, c) for h, sample, own in zip(
                acc.hypotheses, acc.samples, columns) for c in own):
        return
    factor = Beyond("factor", 1.0 / effect.factor, effect.factor, 1.0, 1.0)
    scaled = account(scene, acc.bases, [h._replace(effects=(*h.effects, Found(
        effect, values=dict(factor=factor)))) for h in acc.hypotheses], acc.signatures,
        acc.readings, acc, floor)
    yield Rival(effect, ALL, log_bayes_over(scaled, acc), account=scaled,
                 values=dict(parameter=(ALL, 0.0),
                             **values_of(scaled.member.effects[-1], scaled)))


def column_of(h, key):
    """Number of a parameter of a hypothesis, or None."""
    return next((column for column, (own, p) in enumerate(zip(h.keys, h.parameters))
                 if own == key and p.high > 0.0), None)


def _widened(h, sample, key, factor, scene, signatures):
    """The hypothesis with a wide prior of one parameter, as wide as an effect allows;
    does the record push for it? One that is wrong already is as wide as it may be.
    """
    column = column_of(h, key)
    if column is None or isinstance(h.parameters[column], Beyond):
        return h, False
    p, (effect, symbol) = h.parameters[column], key
    low, high = p.low / factor, p.high * factor
    for one in h.effects:
        if one.key == effect:
            prior = next((q for q in one.effect.parameters(h.scene)
                          if q.symbol == symbol), None)
            if prior is None:    # what its column is measured in is not wrong
                return h, False
            low, high = min(prior.low, p.low), max(prior.high, p.high)
    wide = h.with_prior(key, Beyond(symbol, low, high, p.low, p.high))
    return wide, _pushed(p, sample, column) or _pulled(
        wide, p, sample, column, scene, signatures)


def pushes(acc):
    """Does a record push against an end of a parameter that has a range?"""
    return any(p.free and _pushed(p, acc.sample, column)
               for column, p in enumerate(acc.member.parameters))


RESOLVED = 0.2    # of the standard deviation of a range: a record knows it better


def _pushed(p, sample, column):
    """Does a record push against an end of a parameter, or is it a number?"""
    mean, sd = sample.mean[column], sample.sd()[column]
    return not p.free or (
        min(mean - p.low, p.high - mean) < 2.0 * sd and sd < RESOLVED * p.sd)


OUTSIDE = 32    # values outside a range
PULL = 3.0      # nats by which one of them must be better than any inside


def _pulled(wide, p, sample, column, scene, signatures):
    """Is some value outside the range of a parameter much better, all else as it is
    likeliest? Within a narrow range a record may see no slope.
    """
    if sample.sd()[column] < RESOLVED * p.sd:
        return False
    theta = np.tile(sample.likeliest, (OUTSIDE, 1))
    theta[:, column] = wide.parameters[column].quantile(middles(OUTSIDE))
    return log_likelihoods(wide, scene, signatures, theta).max() > (
        sample.log_likelihood.max() + PULL)


NARROW = np.e    # ends of a range about a number: it is this that may be wrong


def _reference(value, low, high, mean):
    """What a factor is over: the mean of a narrow range, or the nearest end of a wide
    one.
    """
    return mean if 0.0 < high < NARROW * low else np.clip(value, low, high)


def factor_of(key, hypotheses, wide):
    """A parameter over what hypotheses have, mean and sd."""
    column = column_of(wide.member, key)
    if column is None:
        return 1.0, 0.0
    p, mean = hypotheses[wide.best].parameters[column], wide.sample.mean[column]
    reference = _reference(mean, p.low, p.high, p.mean) or 1.0
    return float(mean / reference), float(wide.sample.sd()[column] / reference)
