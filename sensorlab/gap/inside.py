"""Effects inside the filter: processes, jumps and changes of noise, fitted where a
screen or a spectrum promises something.
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from sensorid import at_quantiles, brief, side_by_side
from sensorlab.gap.account import Account, account, mean_evidence
from sensorlab.gap.catalogue import CATALOGUE, columns_for
from sensorlab.gap.changes import onset_law
from sensorlab.gap.costs import say
from sensorlab.gap.filters import SCORE_LIMIT, log_likelihoods, predict
from sensorlab.gap.guesses import guesses_from
from sensorlab.gap.kernels.mixtures import odd_at_first
from sensorlab.gap.kernels.steps import RECENT
from sensorlab.gap.linear import filter_of
from sensorlab.gap.rival import (
    MATTERS, Rival, different, floor_of, least_told, log_bayes_over, values_of)
from sensorlab.gap.screens import (
    FEW, LITTLE, SCREENS, change_of_drive, change_of_level, noise_with, room_of_noise,
    screened, usual_variance)
from sensorlab.gap.spectra import hardly_white, promise, residual_spectrum
from sensorlab.gap.values import NOISY, less_rounding

BY_SPECTRA = "band", "spectrum"    # how an effect inside the filter may be sought
NEXT_TO_NOTHING = 0.1    # of the best ln B: of what has less by its spectrum, a filter
                         # would not tell as much


class _Where(NamedTuple):
    scene: object        # Scene
    plain: object        # Scene without jumps
    acc: Account
    reference: Account   # of the scene without jumps


class Inside(_Where):
    """Where effects inside the filter are sought."""

    __repr__ = brief
    worth_of_few = -np.inf    # ln B of steps at random, where a record shows few

    @functools.cached_property    # of several effects
    def spectra(self):
        """`_spectra` of the account without jumps."""
        return _spectra(self.plain, self.reference)

    @functools.cached_property
    def _known(self):
        """What `promised` has given."""
        return {}

    def prepare(self):
        """Make what `promised` shares, before several threads ask for it at once."""
        return self.spectra, self._known

    def start(self, effect):
        """The scene and the account that an effect is to join."""
        return (self.scene, self.acc) if effect.jumps else (self.plain, self.reference)

    @functools.cached_property    # of several effects
    def scores(self):
        """Normal scores (N,) of the account, and the variance of most innovations."""
        acc = self.acc
        seen = predict(acc.member, self.scene, acc.signatures, acc.theta[None])
        return seen.z[0, 0], usual_variance(seen.z[0, 0], seen.log_score[0, 0])

    def promised(self, effect):
        """(column and variant, hypotheses with an effect in it, about ln B) of each;
        NaN if neither its spectrum nor its column tells anything.
        """
        if effect.name not in self._known:
            scene, start = self.start(effect)
            every = different((
                (column, variant), [h.with_effect(effect, variant, column)
                                    for h in hypotheses])
                for hypotheses, forms in _about_low_passes(effect, start)
                for column in columns_for(effect, scene)
                for variant in forms)
            self._known[effect.name] = [(form, *self._told(
                effect, scene, start, richer)) for form, richer in every]
        return self._known[effect.name]

    def _told(self, effect, scene, start, richer):
        """Hypotheses with an effect in it, and about ln B."""
        if effect.relative_to:
            return richer, noise_with(
                richer[0], richer[0].effects[-1], self.scores[0],
                room_of_noise(self.acc.member, self.acc.theta)).about
        if effect.search not in BY_SPECTRA:
            return richer, np.nan
        richer, told = _promising(scene, start, richer, self.spectra)
        if effect.search == "spectrum" and told < 0.0 and any(
                hardly_white(h, scene, s.likeliest, seen) for h, s, seen in zip(
                    start.hypotheses, start.samples, self.spectra)):
            told = max(told, _told_by_spectra(richer, scene, start))
        return richer, told

    def fitted(self, effect, best, least=0.0):
        """Rivals, one of each variant, that have an effect; `best` is the largest ln B
        of all others, `least` that by a spectrum which is worth a filter.
        """
        say(f"fitting {effect.name.replace('_', ' ')}", 4 if effect.jumps else 1)
        (scene, start), result = self.start(effect), []
        for (column, variant), richer, told in self.promised(effect):
            if told < least:
                result.append(Rival(effect, column, told, variant=variant))
                continue
            new = account(scene, self.acc.bases, richer, self.acc.signatures,
                          self.acc.readings, start, floor_of(start, best))
            if rests_on_rounding(new, scene):
                continue
            here, steps = log_bayes_over(new, start), _steps(new, scene)
            if steps < MANY_STEPS:
                self.worth_of_few = here
            if steps < FEWEST_STEPS:
                continue
            best = max(best, here)
            result.append(Rival(effect, column, here, account=new,
                                 values=values_of(new.member.effects[-1], new),
                                 variant=variant))
        return result


def _about_low_passes(effect, acc):
    """Lists of hypotheses of an account to which an effect may be added, each with the
    forms in which it may be. A process, or a level, passes a low-pass that all passes,
    or one that was found is of the white noise alone and it is behind that. What is
    added before one passes one that is said to be of the white noise alone, too, where
    that is the same.
    """
    forms = acc.member.forms(effect)
    yield acc.hypotheses, forms
    passes = acc.member.without_jumps.with_effect(effect).moves_a_level if (
        effect.jumps) else effect.model and not effect.reading
    if passes and any(one.acts_on_all for one in acc.member.effects):
        yield [h.behind_low_passes(base) for h, base in zip(
            acc.hypotheses, acc.bases)], forms
    if effect.before:
        before = [h.with_low_passes_of_all for h in acc.hypotheses]
        yield before, [form for form in before[0].forms(effect) if form not in forms]


def told_inside(inside, effects, processes=True):
    """Effects inside the filter: models, if wanted, jumps and changes of noise; and
    about ln B of each, NaN where nothing knows it before it is fitted.
    """
    wanted = [effect for effect in effects if (
        effect.jumps or effect.drive
        or processes and effect.model and not effect.reading)
        and _has_room(effect, inside.acc)]
    # what takes longest is first
    wanted = sorted(wanted, key=lambda effect: not effect.jumps)
    return dict(zip(wanted, _told_by_screens(inside, wanted)))


def with_filters(inside, told, best, surely):
    """Rivals that are inside the filter, of which so much is `told`; `best` is the
    largest ln B of all others, and of that of the name `surely`, which is fitted
    whatever is told of it.
    """
    most, rivals = 0.0, []    # ln B of those that have a screen
    # where scores tell much, filters are first, then those of which most is told: the
    # others may do without
    for effect, about in sorted(told.items(), key=lambda own: (
            own[0].name not in SCREENS, -np.nan_to_num(own[1]))):
        least, other = (FEW, most) if effect.name in SCREENS else (LITTLE, best)
        # in bands, spectra tell too little of a line: they but say which comes first
        if effect.search not in BY_SPECTRA and effect.name != surely and (
                about < max(least, least_told(other))):
            rivals += [Rival(effect, column, told, variant=variant)
                       for (column, variant), _, told in inside.promised(effect)
                       ] if effect.relative_to else [Rival(effect, "", about)]
            continue
        own = inside.fitted(effect, best, 0.0 if effect.name == surely else max(
            NEXT_TO_NOTHING * best - MATTERS, 0.0))
        rivals += own
        here = max((one.log_bayes for one in own), default=0.0)
        best = max(best, here)
        if effect.name in SCREENS:
            most = max(most, here)
    return rivals


def _told_by_screens(inside, effects):
    """About ln B of each effect inside the filter; NaN where no screen knows it."""
    scene, plain, acc, reference = inside
    z, variance = inside.scores

    def told(effect):
        if effect.search in BY_SPECTRA or effect.relative_to:
            return max(told for *_, told in inside.promised(effect))
        if effect.drive and effect.name not in SCREENS:
            return change_of_drive(effect, plain, reference.member, acc.signatures,
                                   reference.theta).about
        if effect.jumps and effect.name not in SCREENS:
            return max(change_of_level(effect, scene, acc.member, acc.signatures,
                                       acc.theta), _told_by_spectra(
                [h.with_effect(effect) for h in acc.hypotheses], scene, acc))
        if effect.model and not (effect.search or effect.jumps):
            return _told_by_spectra([h.with_effect(effect) for h in
                                     reference.hypotheses], plain, reference)
        if effect.name == "outliers" and len(odd_at_first(scene.y[None])):
            return np.inf    # to a filter that takes it for the level, others are odd
        if np.nanmax(np.abs(z), initial=0.0) >= SCORE_LIMIT:
            return np.inf    # it tells too little of how far off a sample is
        about = screened(effect, scene, z, variance)
        if effect.name == "outliers" and any(
                one.effect.of_all for one in acc.member.effects):
            # to a filter that knows no white noise, one is a burst
            about = max(about, screened(CATALOGUE["noise_bursts"], scene, z, variance))
        return about
    if any(effect.search in BY_SPECTRA for effect in effects):
        inside.prepare()
    return side_by_side(told, effects)


def _told_by_spectra(richer, scene, acc):
    """About ln B of a process, or of a level, that hypotheses of an account have now:
    the integral of the posterior of their filter, were that the normal law which the
    process of the same covariance has by the spectrum.
    """
    def of(number):
        h = richer[number]
        laws = guesses_from(acc, number, h, scene, acc.signatures)
        if not laws:
            return -np.inf
        theta, moved = at_quantiles(h.parameters, ndtr([mean for mean, _ in laws])), 0.0
        if move := onset_law(h, scene, acc.signatures):
            theta, moved = move(theta)
        ll = log_likelihoods(h, scene, acc.signatures, theta) + moved
        return max(height - 0.5 * mean @ mean + 0.5 * np.linalg.slogdet(cov)[1]
                   for height, (mean, cov) in zip(
                       np.where(np.isfinite(ll), ll, -np.inf), laws))
    return mean_evidence(side_by_side(of, range(len(richer)))) - acc.log_evidence


FEWEST_STEPS = 4    # of a level that moves at random: fewer have a time each, ...
MANY_STEPS = 6      # ... so many have none
SURE_STEP = 0.9     # probability of a step where none was to be expected
ONE_STEP = 16       # samples, in which one may seem to be several


def _steps(acc, scene):
    """How many steps of a level that moves at random a record surely shows: of fewer no
    more is known than of a random walk, or each has a time of its own; infinite if
    there is no such level.

    Wherever there surely was one a short while ago, there was one, or as many as there
    should be in such a time.
    """
    if not acc.member.steps:
        return np.inf
    seen = predict(acc.member, scene, acc.signatures, acc.theta[None])
    begin = acc.member.jumps(acc.theta[None]).begin[0]
    none = (1.0 - SURE_STEP) * (1.0 - begin)**RECENT
    sure = np.flatnonzero(1.0 - seen.second[0, 0] < none)
    apart = np.flatnonzero(np.diff(sure, prepend=-np.inf) > ONE_STEP)
    return np.maximum(begin * np.diff(apart, append=len(sure)), 1.0).sum()


def rests_on_rounding(acc, scene):
    """Does a record, where nothing jumps, move less than makes its rounding a white
    noise? What jumps would stand in for the law of that.
    """
    lsb = max((r.found.values.get("lsb", 0.0) for r in acc.readings if not r.coarse),
              default=0.0)
    if not (lsb and acc.member.has_jumps):
        return False
    h = acc.member.without_jumps
    quiet = filter_of(h, scene, acc.signatures, acc.member.matching(h, acc.theta),
                      np.isnan(scene.y))
    noise = np.exp(0.5 * np.median(quiet.log_f))
    return NOISY * less_rounding(noise, lsb) < lsb


def _spectra(scene, acc):
    """`Spectrum` of every hypothesis of an account where it is likeliest."""
    return side_by_side(lambda own: residual_spectrum(
        own[0], scene, acc.signatures, own[1].likeliest),
        list(zip(acc.hypotheses, acc.samples)))


def _promising(scene, acc, richer, spectra):
    """Hypotheses of an account, of these `_spectra`, with a further process, its
    frequency sought, and ln B of it by Whittle's likelihood.
    """
    pairs = side_by_side(
        lambda own: promise(own[0], scene, own[1], own[2].likeliest),
        list(zip(richer, spectra, acc.samples)))
    evidence = np.array([s.log_evidence[0] for s in acc.samples])
    return [h for h, _ in pairs], mean_evidence(
        evidence + [gain for _, gain in pairs]) - mean_evidence(evidence)


MOST_STATES = 10    # of all processes, of each two at most: four bands and a low-pass


def _has_room(effect, acc):
    """Is there room for a process or jumps that are not there yet? There may be several
    bands.
    """
    if not effect.may_repeat and any(
            one.name == effect.name for one in acc.member.effects) or any(
            effect.name == h.hypothesis.model.__name__ for h in acc.hypotheses):
        return False
    if effect.search == "onset" and acc.member.onsets:    # one change of noise
        return False
    columns = columns_for(effect, acc.member.scene)
    if not columns:
        return False
    richer = [h.with_effect(effect, column=columns[0]) for h in acc.hypotheses]
    if not all(h.has_a_filter for h in richer):
        return False
    if max(h.order for h in richer) > MOST_STATES:
        return False
    if effect.relative_to and any(h.is_even for h in richer):    # no white noise left
        return False
    return not effect.drive or effect.of_white or any(
        h.at_mean[-1].Gamma.any() for h in richer)
