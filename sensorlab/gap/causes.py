"""Which effect: probabilities of all that may be missing, one at a time, Eq. (10)."""

import functools
from typing import NamedTuple

import numpy as np
from scipy.special import ive, logsumexp, ndtr

from sensorid import (
    at_quantiles, brief, free_columns, middles, probabilities, side_by_side)
from sensorlab.gap.account import (
    Account, account, evidence_error, fixed, for_processes, for_signatures, gaussian,
    guesses_from, mean_evidence, solved_by)
from sensorlab.gap.catalogue import CATALOGUE, columns_for
from sensorlab.gap.costs import say
from sensorlab.gap.directed import (
    directed, estimate_signature, estimated_beside, nodes_for, onsets_nearby,
    part_about)
from sensorlab.gap.effects import Effect, Found
from sensorlab.gap.evidence import HOPELESS_NATS, effort, onset_law
from sensorlab.gap.filters import filter_of, log_likelihoods, part_of, predict
from sensorlab.gap.lowpass import families_passing, low_pass_of, signature_passing
from sensorlab.gap.readings import as_read
from sensorlab.gap.screens import (
    FEW, HEAD, LITTLE, SCREENS, change_of_drive, change_of_level, noise_with,
    screened, usual_variance)
from sensorlab.gap.signatures import families
from sensorlab.gap.spectra import hardly_white, promise, residual_spectrum
from sensorlab.gap.steps import RECENT
from sensorlab.gap.values import NOISY, less_rounding

UNKNOWN = Effect("unknown")    # something that is in no catalogue


class Cause(NamedTuple):
    """A set of effects as the explanation of a record; the empty one is `none`."""

    found: tuple          # of Found, in the order found; values are (mean, sd)
    probability: float
    log_bayes: float
    error: float = 0.0    # standard deviation of the probability by chance of the nodes
                          # and records that it is computed from

    @property
    def effects(self):
        """Their names."""
        return tuple(one.name for one in self.found)

    @property
    def names(self):
        """Their names in whatever order they were found; unknown is the last."""
        return tuple(sorted(self.effects, key=lambda name: (name == "unknown", name)))

    @property
    def effect(self):
        """Their names as one."""
        return "+".join(self.effects) or "none"

    @property
    def column(self):
        """Their columns as one; "a or b" where columns are alike."""
        return "+".join(one.column for one in self.found if one.column)

    @property
    def parameters(self):
        """Values by name: symbol, or effect.symbol where there are several effects; one
        found again is number 2.
        """
        result = {}
        for one in self.found:
            for symbol, value in one.values.items():
                number, key = 1, symbol
                if len(self.found) > 1:
                    key = f"{one.name}.{symbol}"
                while key in result:
                    number += 1
                    key = f"{one.name}_{number}.{symbol}"
                result[key] = value
        return result


class Further(NamedTuple):
    """One look for a further effect."""

    causes: tuple      # of Cause, most probable first, none among them
    account: Account   # with the most probable effect in it; None where it is none
    prior: float       # log odds of any one further effect, a priori
    few_steps: bool = False    # are steps at random the best, but few?

    __repr__ = brief


class _Rival(NamedTuple):
    """One further effect, on one column or in one parameter, against none."""

    effect: Effect
    at: str              # column, or symbol of the parameter that is wrong
    log_bayes: float
    family: int = 0      # number of its family in the evidence, from 1
    account: Account = None    # with the effect in it; a signature has a family instead
    values: dict = {}    # (mean, sd) by symbol
    variant: str = ""
    chosen: Account = None    # with it, by the filter with jumps, where what stood in
                              # for these misled


LISTED_FROM = 0.01  # probability from which on a cause is worth its parameters, which
                    # cost a long record more
PRIOR_NONE = 0.5    # that nothing is missing
PRIOR_LAST = 0.75   # that nothing more is: a second effect is half as likely as a first
SIMPLER = 1.0 / 3.0    # of the prior of an effect that has a simpler one within it,
                       # that goes to this: a step need not be gradual (H. Jeffreys,
                       # "Theory of Probability", 1961)
NO_OTHER = "", 0.0     # of which ln B is known


def further_causes(scene, acc, effects, processes=True, by_chance=None,
                   known=NO_OTHER, among=1):
    """`Further`: probability of every further effect, Eq. (10), and the best account.

    Without `processes`, for signatures, jumps and changes. `by_chance`, a function of
    an effect and its ln B, gives what is left of that less chance; `known` is the name
    of an effect of which ln B is known, and that; without a name it is what others
    have, and if all here come to far less, none is told of. Each is as likely as one
    `among` so many, a priori, if there are fewer here.
    """
    inside, plain, reference, listed, samples, grids, rivals = _sought(
        scene, acc, effects, processes, known)
    name, least = known
    if not name and max([0.0, *(one.log_bayes for one in rivals)]) < _about(least):
        return Further((Cause((), 1.0, 0.0),), None, -np.inf)
    say("weighing", 2)

    def estimated(number, count=None):
        return estimate_signature(plain, reference, listed[number - 1], samples, number,
                                  grids, count)
    signatures = _Estimated(estimated)
    weighed, chosen = _with_best(inside, plain, reference, rivals, signatures,
                                 _Estimated(lambda number: estimated(number, 1)),
                                 by_chance, among)
    prior, alone, share, groups = weighed
    error = _errors(alone, share, groups, np.array([
        _error(rival, acc, samples) for rival in rivals]))
    causes = [Cause((), float(alone), 0.0, error[0])]
    for group, off in zip(groups, error[1:]):
        rival, probability = rivals[group[0]], share[group].sum()
        column = "" if rival.effect.factor else _either(list(dict.fromkeys(
            rivals[i].at for i in group if rivals[i].at
            and share[i] > 0.1 * share[group[0]])))
        if rival.family and (probability > LISTED_FROM / effort(scene)
                             or chosen and group[0] == weighed.best):
            _, one = signatures[rival.family]
        else:
            one = Found(rival.effect, "", rival.variant, rival.values,
                        float(share[group[0]] / max(probability, 1e-300)))
        causes.append(Cause((one._replace(column=column),), float(probability),
                            float(rival.log_bayes), off))
    causes.sort(key=lambda c: -c.probability)
    return Further(tuple(causes), chosen, prior, inside.worth_of_few >= max(
        [0.0, *(one.log_bayes for one in rivals)]))


class _Estimated(dict):
    """`Signature` and `Found` of families by number, estimated when they are asked for.
    """

    def __init__(self, estimate):
        self._estimate = estimate

    def __missing__(self, number):
        self[number] = self._estimate(number)
        return self[number]


class _Sought(NamedTuple):
    """What was found of further effects."""

    inside: object       # _Inside: where those inside the filter were sought
    plain: object        # Scene without jumps, where signatures were
    reference: Account   # of that scene
    listed: list         # of Family
    samples: list        # of Sample: their evidence, one of every hypothesis
    grids: dict          # number of a family -> `Grid` where it was resolved
    rivals: list         # of _Rival


def _sought(scene, acc, effects, processes=True, known=NO_OTHER):
    """`_Sought` of some effects; see `further_causes`."""
    if acc.member.steps:    # what begins at some time is one more step, or two
        effects = [e for e in effects if not (e.columns and e.search in (
            "onset", "pulse"))]
    stand_in = gaussian(scene, acc)
    plain, reference = _without_jumps(scene, acc, for_signatures(scene, acc, stand_in))
    listed = families(plain, effects, acc.signatures)
    low_pass = low_pass_of(acc.member, acc.theta)
    if low_pass:
        listed += families_passing(low_pass, listed)
    say("looking for signatures", 4)
    name, best = known
    samples = directed(plain, reference, listed, grids=(grids := {}),
                       least=0.0 if name else _about(best))
    rivals = _with_signatures(listed, samples)
    even, of_even = _without_jumps(
        scene, acc, for_processes(scene, acc, stand_in), (plain, reference))
    inside = _Inside(scene, even, acc, of_even)
    rivals += _with_filters(inside, effects, processes, max(
        [best, *(one.log_bayes for one in rivals)]), name)
    wrong = [effect for effect in effects if effect.factor]
    if processes:
        floor = _floor(acc, max([best, *(one.log_bayes for one in rivals)]))
        rivals += [rival for effect in wrong
                   for wrongly in (_with_wrong_parameters, _with_wrong_scale)
                   for rival in wrongly(scene, acc, effect, floor)
                   if not _rests_on_rounding(rival.account, scene)]
    rivals += [rival for effect in wrong
               for rival in _with_wrong_sizes(scene, acc, effect)]
    return _Sought(inside, plain, reference, listed, samples, grids, rivals)


def largest_bayes(scene, acc, effect):
    """Largest ln B of one further effect in any form; 0 if nothing is for it."""
    return max([0.0, *(one.log_bayes for one in _sought(scene, acc, [effect]).rivals)])


def _without_jumps(scene, acc, stand_in, like=None):
    """The scene and the account where another effect is sought, of a scene and
    hypotheses that stand in for those with jumps; those like it, if they are the same.
    """
    plain, hypotheses = stand_in
    if plain is scene:
        return scene, acc
    if like and hypotheses == like[1].hypotheses and np.array_equal(
            plain.y, like[0].y, equal_nan=True):
        return like
    return plain, account(plain, hypotheses, signatures=acc.signatures, past=acc)


def search_cost(effect, scene):
    """What the best of as many signatures as a pulse has gains by chance over the best
    of as many as a step has, nats: an account has that one alone, of a wide size.
    """
    more = len(effect.parameters(scene)) - 1 if effect.columns else 0
    return max(more, 0) * np.log(len(scene.y))


def _with_signatures(listed, samples):
    """Rivals that are signatures."""
    table = np.array([s.log_evidence for s in samples])
    base = mean_evidence(table[:, 0])
    return [_Rival(family.effect, family.column, mean_evidence(table[:, number]) - base,
                   number) for number, family in enumerate(listed, 1)]


MATTERS = 4.0    # nats below the best rival: what lies lower need not be known well
BY_SPECTRA = "band", "spectrum"    # how an effect inside the filter may be sought
AT_LEAST = 0.7    # of the best ln B, or of what another screen of the scores tells: a
                  # screen that tells less is good enough


def _about(best):
    """The least ln B by a screen, or by what stands in for jumps, with which an effect
    may come near the best.
    """
    return AT_LEAST * best - MATTERS


class _Where(NamedTuple):
    scene: object        # Scene
    plain: object        # Scene without jumps
    acc: Account
    reference: Account   # of the scene without jumps


class _Inside(_Where):
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
            every = _different((
                (column, variant), [h.with_effect(effect, variant, column)
                                    for h in after])
                for after in _after_low_passes(effect, start)
                for column in columns_for(effect, scene)
                for variant in effect.variants or ("",))
            self._known[effect.name] = [(form, *self._told(
                effect, scene, start, richer)) for form, richer in every]
        return self._known[effect.name]

    def _told(self, effect, scene, start, richer):
        """Hypotheses with an effect in it, and about ln B."""
        if effect.relative_to:
            return richer, noise_with(scene, richer[0].effects[-1],
                                      self.scores[0]).about
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
                result.append(_Rival(effect, column, told, variant=variant))
                continue
            new = account(scene, self.acc.bases, richer, self.acc.signatures,
                          self.acc.readings, start, _floor(start, best))
            if _rests_on_rounding(new, scene):
                continue
            here, steps = _log_bayes(new, start), _steps(new, scene)
            if steps < MANY_STEPS:
                self.worth_of_few = here
            if steps < FEWEST_STEPS:
                continue
            best = max(best, here)
            result.append(_Rival(effect, column, here, account=new,
                                 values=_values(new.member.effects[-1], new),
                                 variant=variant))
        return result


def _after_low_passes(effect, acc):
    """Lists of hypotheses of an account to which a process may be added: it passes a
    low-pass that all passes, or one that was found is of the white noise alone and the
    process is behind it.
    """
    yield acc.hypotheses
    if effect.model and not effect.jumps and not effect.reading and any(
            one.acts_on_all for one in acc.member.effects):
        yield [h.behind_low_passes(base) for h, base in zip(acc.hypotheses, acc.bases)]


def _different(forms):
    """Those (variant, hypotheses) of which no earlier one has the same filters."""
    result, known = [], []
    for variant, richer in forms:
        filters = [h.at_mean[-1] for h in richer]
        if any(all(np.array_equal(a, b) for one, own in zip(filters, other)
                   for a, b in zip(one, own)) for other in known):
            continue
        known.append(filters)
        result.append((variant, richer))
    return result


def _with_filters(inside, effects, processes, best, surely):
    """Rivals that are inside the filter: models, if wanted, jumps and changes of
    noise; `best` is the largest ln B of all others, and of that of the name `surely`,
    which is fitted whatever is told of it.
    """
    wanted = [effect for effect in effects if (
        effect.jumps or effect.drive
        or processes and effect.model and not effect.reading)
        and _has_room(effect, inside.acc)]
    # what takes longest is first
    wanted = sorted(wanted, key=lambda effect: not effect.jumps)
    told = dict(zip(wanted, _told_by_screens(inside, wanted)))
    most, rivals = 0.0, []    # ln B of those that have a screen
    # where scores tell much, filters are first, then those of which most is told: the
    # others may do without
    for effect, about in sorted(told.items(), key=lambda own: (
            own[0].name not in SCREENS, -np.nan_to_num(own[1]))):
        least, other = (FEW, most) if effect.name in SCREENS else (LITTLE, best)
        # in bands, spectra tell too little of a line: they but say which comes first
        if effect.search not in BY_SPECTRA and effect.name != surely and (
                about < max(least, _about(other))):
            rivals += [_Rival(effect, column, told, variant=variant)
                       for (column, variant), _, told in inside.promised(effect)
                       ] if effect.relative_to else [_Rival(effect, "", about)]
            continue
        own = inside.fitted(effect, best)
        rivals += own
        here = max((one.log_bayes for one in own), default=0.0)
        best = max(best, here)
        if effect.name in SCREENS:
            most = max(most, here)
    return rivals


def _floor(acc, best):
    """Log evidence below which a rival of the best, by its ln B over an account, need
    not be known well.
    """
    return acc.log_evidence + max(HOPELESS_NATS, best - MATTERS)


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
        if effect.model and not effect.search:
            return _told_by_spectra([h.with_effect(effect) for h in
                                     reference.hypotheses], plain, reference)
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


def _rests_on_rounding(acc, scene):
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


def _log_bayes(new, old):
    """ln B of a richer account: where in its ranges the base lies is no evidence
    against it, so it is no more than the likelihood ratio less Akaike's correction.
    """
    more = max(len(free_columns(h.parameters)) - len(free_columns(o.parameters))
               for h, o in zip(new.hypotheses, old.hypotheses))
    return min(new.log_evidence - old.log_evidence,
               new.peak - old.peak - max(more, 1))


def _values(own, acc):
    """Mean and standard deviation of the parameters of one of the effects inside the
    filters of an account, under the most probable hypothesis: beside another process it
    may be another.
    """
    sample, result = acc.sample, {}
    for symbol, prior in own.values.items():
        if not prior.free:
            result[symbol] = prior.low, 0.0
            continue
        value = acc.member.value(sample.theta, own.key, symbol)
        mean = sample.weight @ value
        result[symbol] = float(mean), float(np.sqrt(sample.weight @ (value - mean)**2))
    return result


def _probabilities(acc, rivals, among=1):
    """Prior log odds of a rival on average, `among` so many at least; probability of
    none, of every rival.
    """
    first = not (acc.signatures or acc.readings or len(acc.member.effects) > len(
        acc.bases[acc.best].effects))
    alone = PRIOR_NONE if first else PRIOR_LAST
    prior = np.log((1.0 - alone) / alone / max(len(rivals), among))
    weight, number = np.ones(len(rivals)), {
        (rival.effect.name, rival.at): k for k, rival in enumerate(rivals)}
    for k, rival in enumerate(rivals):
        for simpler in np.atleast_1d(rival.effect.becomes).tolist():
            if (simpler, rival.at) in number:
                weight[[k, number[simpler, rival.at]]] += -SIMPLER, SIMPLER
        if rival.variant in rival.effect.alike:
            weight[k] /= sum(one.effect is rival.effect and one.at == rival.at
                             and one.variant in rival.effect.alike for one in rivals)
    share = probabilities([0.0, *(prior + np.log(own) + rival.log_bayes
                                  for own, rival in zip(weight, rivals))])
    return prior, share[0], share[1:]


def _error(rival, acc, samples):
    """Standard deviation of ln B of a rival by chance of the nodes, nats."""
    if rival.family:
        return evidence_error(samples, rival.family)
    return np.hypot(rival.account.error, acc.error) if rival.account else 0.0


def _errors(alone, share, groups, off):
    """Standard deviations of the probabilities of none and of groups of rivals, of
    probabilities `share` (R,), whose ln B have the standard deviations `off` (R,).
    """
    total = [alone] + [share[group].sum() for group in groups]
    own = np.zeros((len(total), len(share)))
    for number, group in enumerate(groups, 1):
        own[number, group] = 1.0
    slope = share * (own - np.array(total)[:, None])
    return np.sqrt((slope * off)**2 @ np.ones(len(share))).tolist()


def _grouped(rivals, share):
    """Numbers of the rivals of each effect, most probable first: columns are rivals in
    where an effect comes from, not in what it is.
    """
    groups = {}
    for number in np.argsort(-share):
        groups.setdefault(rivals[number].effect.name, []).append(number)
    return list(groups.values())


def _either(columns):
    """Columns of which any may be the cause, as text."""
    return " or ".join(columns if len(columns) <= 3 else
                       [*columns[:2], f"{len(columns) - 2} others"])


class _Weighed(NamedTuple):
    """What rivals are worth beside none and beside each other."""

    prior: float         # log odds of any, a priori
    alone: float         # probability of none
    share: np.ndarray    # (R,) of each rival
    groups: list         # of lists of their numbers, by effect, most probable first

    @property
    def best(self):
        """Number of the most probable rival of the most probable effect."""
        return max(self.groups, key=lambda own: self.share[own].sum())[0]


def _with_best(inside, plain, reference, rivals, signatures, glimpsed, by_chance,
               among):
    """`_Weighed` of the rivals, and the account with the best in it, or None where none
    is as probable. What proves to be worth less or more on the way is so among the
    rivals, too.

    The `signatures` of families, by number, were sought in the scene `plain`, of which
    `reference` is the account; where jumps see one elsewhere, it is moved. To weigh
    them beside jumps, those `glimpsed` at one node will do. `by_chance` and `among` as
    for `further_causes`.
    """
    scene, acc, known = inside.scene, inside.acc, {}

    def account_with(one):
        """The account with a rival, and ln B of it by that."""
        key = one.family, id(one.account)
        if key not in known:    # by the filter with jumps it is dear
            none, some = acc.log_evidence, signatures
            if plain is not scene and one.family:
                none, some = none + seen_elsewhere(one, glimpsed), glimpsed
            new = _account_with(scene, plain, acc, one, some, none + HOPELESS_NATS)
            known[key] = one.account, new, new.log_evidence - none    # it stays alive
        return known[key][1:]

    def seen_elsewhere(one, some):
        searched, some[one.family] = _seen_elsewhere(
            scene, acc, plain, reference, one, *some[one.family])
        return searched

    def settled(one, chosen):
        """The account with the best rival, which may be known by a glimpse."""
        if plain is scene or not one.family:
            return chosen
        seen_elsewhere(one, signatures)
        return _account_with(scene, plain, acc, one, signatures)
    if plain is not scene:
        _seen_by_jumps(rivals, account_with)
    while True:
        prior, alone, share = _probabilities(acc, rivals, among)
        weighed = _Weighed(prior, alone, share, _grouped(rivals, share))
        if alone >= 0.5:
            return weighed, None
        best = rivals[weighed.best]
        if best.chosen:
            return weighed, settled(best, best.chosen)
        if not best.family and best.account is None:    # what was told of it sufficed
            rivals[:] = [one for one in rivals if one.effect is not best.effect]
            rivals += inside.fitted(best.effect, 0.0, -np.inf)
            continue
        chosen, worth = account_with(best)
        # what stood in for the jumps may mislead
        worth = best.log_bayes if plain is scene else min(best.log_bayes, worth)
        if by_chance:
            worth = by_chance(best.effect, worth)
        if worth == best.log_bayes:
            return weighed, settled(best, chosen)
        rivals[weighed.best] = best._replace(chosen=chosen, log_bayes=worth)


NEARBY = 4    # samples to either side of an onset, which what stands in for jumps hides


def _seen_elsewhere(scene, acc, plain, reference, rival, one, found):
    """How much less a signature is worth on average, over where its onset and the like
    may be, than where the filter with jumps sees it, nats; and the pair of `Signature`
    and `Found` with the onset, of those nearby, that it sees.

    It was sought in the scene `plain`, where its average is known.
    """
    there = with_signature(plain, reference, one).log_evidence - reference.log_evidence
    searched = max(there - rival.log_bayes, 0.0)
    near = onsets_nearby(scene, one, NEARBY)
    if len(near) < 2:
        return searched, (one, found)
    part = part_about(scene, one) if acc.member.is_even and (
        reference.member.is_even) else slice(None)
    seen, sought = (np.array([log_likelihoods(own.member, *part_of(
        at, (*own.signatures, other), part), own.theta[None])[0] for other in near])
        for at, own in ((scene, acc), (plain, reference)))
    best = near[seen.argmax()]
    mean, sd = found.values["onset"]
    away = best.found.values["onset"] - one.found.values["onset"]
    middle = [other is one for other in near].index(True)
    spread = logsumexp(sought - sought[middle]) - logsumexp(seen - seen.max())
    return max(searched + spread, 0.0), (best, found._replace(
        values={**found.values, "onset": (mean + away, sd)}))


MOST_RAISED = 3    # signatures nearly as good as the best: one alone would gain on them


def _seen_by_jumps(rivals, account_with):
    """The best of the rivals that were sought where something stands in for jumps,
    signatures and a process, where the filter with jumps sees more of them.
    """
    for listed in True, False:
        own = sorted((k for k, one in enumerate(rivals) if not one.effect.jumps
                      and (one.family > 0) == listed and (
                          listed or one.account and one.effect.model)),
                     key=lambda k: -rivals[k].log_bayes)[:MOST_RAISED if listed else 1]
        least = max(rivals[own[0]].log_bayes - MATTERS, 0.0) if own else 0.0
        for k in own:
            if k != own[0] and rivals[k].log_bayes < least:
                break
            chosen, worth = account_with(rivals[k])
            if worth > rivals[k].log_bayes:
                rivals[k] = rivals[k]._replace(chosen=chosen, log_bayes=worth)


def _account_with(scene, plain, acc, best, signatures, floor=-np.inf):
    """The account with a rival in it; `floor` as for `account`, of filters with jumps.
    """
    floor = -np.inf if plain is scene else floor
    if best.family:
        return with_signature(scene, acc, signatures[best.family][0], floor)
    if plain is not scene and best.effect.model and not best.effect.jumps:
        return account(scene, acc.bases,
                       [h.joined(own.effects[-1]) for h, own in zip(
                           acc.hypotheses, best.account.hypotheses)],
                       acc.signatures, acc.readings, acc, floor)
    return best.account


def with_signature(scene, acc, one, floor=-np.inf):
    """An account with one more signature; `floor` as for `account`."""
    return account(scene, acc.bases, acc.hypotheses, (*acc.signatures, one),
                   acc.readings, acc, floor)


def estimated_together(full, acc, path):
    """The set of effects of a path with the parameters that its account gives them:
    each was found before the others were known, or beside some that are left out.
    """
    if not path.found:
        return path
    result, at = [], len(acc.signatures) - sum(
        bool(one.effect.columns) for one in path.found)
    scene, hypotheses = gaussian(as_read(full, acc.readings), acc)
    h = hypotheses[acc.best]
    nodes = np.array([acc.member.matching(h, theta)
                      for theta in acc.sample.nodes(nodes_for(scene) // 2)])
    for number, one in enumerate(path.found):
        if one.effect.columns:
            own, at = acc.signatures[at], at + 1
            one = one._replace(low_pass=own.found.low_pass)
            values = estimated_beside(scene, h, [
                other for other in acc.signatures if other is not own], own, nodes)
        elif _is_single(one):
            values = {} if _held_by(acc.signatures, one) else dict(
                factor=_factor(_wrong_key(one), acc.bases, acc))
        else:
            values = {}
            if not one.effect.reading:
                own = _inside(acc, path.found, number)
                one, values = one._replace(variant=own.variant), _values(own, acc)
        result.append(one._replace(values={**one.values, **values}))
    return path._replace(found=tuple(result))


def _inside(acc, found, number):
    """Effect `number` of those found, as it is inside the filters of an account."""
    name = found[number].name
    later = sum(one.name == name and not _is_single(one) for one in found[number + 1:])
    return [one for one in acc.member.effects if one.name == name][-1 - later]


def without(full, acc, found, number, floor=-np.inf):
    """The account less effect `number` of those found, fitted again; `floor` as for
    `account`.
    """
    one = found[number]
    hypotheses, signatures = acc.hypotheses, acc.signatures
    if one.effect.reading:
        return _without_reading(full, acc, one)
    if one.effect.columns:
        # those of the simulator come first
        at = len(signatures) - sum(bool(f.effect.columns) for f in found[number:])
        signatures = signatures[:at] + signatures[at + 1:]
    elif held := _held_by(signatures, one):
        signatures = tuple(s._replace(gain=0.0) if s is held[0] else s
                           for s in signatures)
    elif _is_single(one):
        key = _wrong_key(one)
        hypotheses = [
            h if _column(base, key) is None else h.with_prior(
                key, base.parameters[_column(base, key)]).with_form(
                    key[0], _form(acc.bases, key[0]))
            for h, base in zip(hypotheses, acc.bases)]
    else:
        key = _inside(acc, found, number).key
        hypotheses = [h._replace(effects=tuple(
            e for e in h.effects if e.key != key)) for h in hypotheses]
    return account(as_read(full, acc.readings), acc.bases, hypotheses, signatures,
                   acc.readings, acc, floor)


RATIOS = 1.3, 1.09, 1.03    # of the parameters at which forms are compared


def in_best_forms(full, acc, found):
    """The account with the effects inside its filters in the forms that are likeliest
    beside all that is found now: while outliers are not known, they fill the band that
    a low-pass stops, and hide its form. Of a long record the head tells which it is.
    """
    in_forms = [n for n, one in enumerate(found) if one.effect.variants]
    if not in_forms:
        return acc
    scene = as_read(full, acc.readings)
    head = slice(None if acc.member.onsets else HEAD)
    for number in in_forms:
        own = _inside(acc, found, number)
        forms = [(hypotheses, signatures) for form, hypotheses in _different(
            (form, [h.with_form(own.key, form) for h in acc.hypotheses])
            for form in (own.variant, *own.effect.variants))
            for signatures in _before_or_after(acc, hypotheses, scene)]
        if len(forms) < 2:
            continue
        here, *others = side_by_side(lambda form: _near(
            *part_of(scene, form[1], head), acc, form[0][acc.best], own.key), forms)
        best = int(np.argmax(others))
        if others[best] > here:
            new = account(scene, acc.bases, *forms[1 + best], acc.readings, acc)
            acc = max(acc, new, key=lambda either: either.log_evidence)
    return acc


def _before_or_after(acc, hypotheses, scene):
    """The signatures of an account as they are, and, if its hypotheses are to have a
    low-pass that all passes: those that pass one as they pass it, and all of them.
    """
    yield acc.signatures
    h = hypotheses[acc.best]
    low_pass, known = low_pass_of(h, acc.member.matching(h, acc.theta)), acc.signatures
    for every in (False, True) if low_pass else ():
        passed = tuple(signature_passing(low_pass, one, scene, every) for one in known)
        if any(one is not own for one, own in zip(passed, known)):
            yield passed
        known = passed


def _near(scene, signatures, acc, h, key):
    """Largest log-likelihood of a hypothesis at parameters that an account has, but for
    those of the effect of a key, which are near these.
    """
    theta, best = acc.member.matching(h, acc.theta), -np.inf
    columns = [c for c, (effect, _) in enumerate(h.keys)
               if effect == key and h.parameters[c].free]
    for ratio in RATIOS:
        for column in columns:
            tried = np.repeat(theta[None], 3, axis=0)
            tried[:, column] = np.clip(theta[column] * ratio**np.arange(-1.0, 2.0),
                                       h.parameters[column].low,
                                       h.parameters[column].high)
            told = log_likelihoods(h, scene, signatures, tried)
            theta, best = tried[told.argmax()], max(best, told.max())
    return best


def _without_reading(full, acc, one):
    """The account less a reading, or with the simulator's own instead."""
    (gone,) = [r for r in acc.readings if r.found.effect.reading is one.effect.reading]
    if gone.beyond:    # within limits there is no such record
        return acc
    readings = tuple(gone.instead if r is gone else r for r in acc.readings
                     if r is not gone or gone.instead)
    own = fixed(**gone.instead.found.values) if gone.instead else {}
    hypotheses = [h._replace(effects=tuple(
        e._replace(values=own or e.values) if e.name == gone.found.name else e
        for e in h.effects if own or e.name != gone.found.name))
        for h in acc.hypotheses]
    return account(as_read(full, readings), acc.bases, hypotheses, acc.signatures,
                   readings, acc)


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
    if richer[0].levels > 1 or not all(h.can_be_filtered for h in richer):
        return False
    if max(h.order for h in richer) > MOST_STATES:
        return False
    if effect.relative_to and any(h.is_even for h in richer):    # no white noise left
        return False
    return not effect.drive or effect.of_white or any(
        h.at_mean[-1].Gamma.any() for h in richer)


def _with_wrong_parameters(scene, acc, effect, floor):
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
        its_own = _form(acc.bases, own)
        for form, members in _different((form, [
                h.with_form(own, form) for h, _ in widened])
                for form in _forms(acc.bases, own)):
            wide = account(scene, acc.bases, members, acc.signatures, acc.readings, acc,
                           floor)
            other = {} if form == its_own else dict(form=(form, 0.0))
            yield _Rival(effect, name, _log_bayes(wide, acc), account=wide,
                         values=dict(parameter=(name, 0.0), **other,
                                     factor=_factor(key, acc.hypotheses, wide)))


SPREAD, STEPS = 8.0, 321    # standard errors about an amplitude, and in how many steps


def _with_wrong_sizes(scene, acc, effect):
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
        yield _Rival(effect, name, gain, account=acc._replace(
            signatures=loose, log_evidence=acc.log_evidence + gain), values=dict(
                parameter=(name, 0.0), factor=(float(mean), float(np.sqrt(
                    w @ (factor - mean)**2 / w.sum())))))


def _form(bases, key):
    """Which form of an effect, by its key, a simulator has; "" if there is but one."""
    return next((one.variant or one.effect.variants[0] for base in bases
                 for one in base.effects if one.key == key and one.effect.variants), "")


def _forms(bases, key):
    """The form of an effect that a simulator has, then all others."""
    own = _form(bases, key)
    others = next((one.effect.variants for base in bases for one in base.effects
                   if one.key == key), ())
    return (own, *(form for form in others if form != own))


ALL = "all"    # standard deviations, by one factor


def _is_single(one):
    """Is it a single parameter that is wrong?"""
    return one.effect.factor and one.values["parameter"][0] != ALL


def _held_by(signatures, one):
    """The line of the simulator whose amplitude is wrong, if it is that, in a list."""
    return [s for s in signatures if one.effect.factor and s.gain and one.values.get(
        "parameter", ("",))[0] == f"{s.found.name}.{s.found.effect.size}"][:1]


def _wrong_key(one):
    """Key (effect, symbol) of the single parameter that is wrong; "" is no effect."""
    effect, _, symbol = one.values["parameter"][0].rpartition(".")
    return effect, symbol


def _with_wrong_scale(scene, acc, effect, floor):
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
    yield _Rival(effect, ALL, _log_bayes(scaled, acc), account=scaled,
                 values=dict(parameter=(ALL, 0.0),
                             **_values(scaled.member.effects[-1], scaled)))


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


def _column(h, key):
    """Number of a parameter of a hypothesis, or None."""
    return next((column for column, (own, p) in enumerate(zip(h.keys, h.parameters))
                 if own == key and p.high > 0.0), None)


def _widened(h, sample, key, factor, scene, signatures):
    """The hypothesis with a wide prior of one parameter, as wide as an effect allows;
    does the record push for it? One that is wrong already is as wide as it may be.
    """
    column = _column(h, key)
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


def _factor(key, hypotheses, wide):
    """A parameter over what hypotheses have, mean and sd."""
    column = _column(wide.member, key)
    if column is None:
        return 1.0, 0.0
    p, mean = hypotheses[wide.best].parameters[column], wide.sample.mean[column]
    reference = _reference(mean, p.low, p.high, p.mean) or 1.0
    return float(mean / reference), float(wide.sample.sd()[column] / reference)
