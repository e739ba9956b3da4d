"""Distance: statistics of a record beside those of records of the fitted simulator.

The distance of a statistic is in standard deviations of the simulated records, put
through the same fit; the p-value of a place is that of its largest distance.
"""

from typing import NamedTuple

import numpy as np

from sensorid import brief, free_columns, side_by_side
from sensorlab.gap.catalogue import ROUNDED, quantize
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import BLOCK, LONG_RECORD, Scene
from sensorlab.gap.filters import filtered, predict, predict_first
from sensorlab.gap.implied import as_simulated, in_place
from sensorlab.gap.linear import Filter, Shared, filter_of, shared
from sensorlab.gap.places import PLACES, Statistics, statistics
from sensorlab.gap.probes import Probes, probes
from sensorlab.gap.readings import misleads, without_readings
from sensorlab.gap.standins import gaussian
from sensorlab.gap.values import COARSE, lattice_and_noise, noise_of


class Gap(NamedTuple):
    """Distance of a record from the records of a fitted simulator."""

    statistics: Statistics    # of the record
    distance: np.ndarray      # (S,) in standard deviations
    null: np.ndarray          # (B, S) the same of the simulated records
    p_place: dict             # place -> p-value
    p_value: float            # of the whole
    theta: np.ndarray         # parameters at which they were simulated
    z: np.ndarray             # (N,) normal scores of the record
    log_score: np.ndarray     # (N,) ln of its one-step-ahead densities
    ruler: tuple              # what measures other records in the same way
    beside: np.ndarray        # (B, S) distances of the same simulated records from
                              # another simulator; None if there is no other
    drawn: tuple              # of Drawn: the simulated records

    __repr__ = brief

    def rms(self, where=slice(None)):
        """Root mean square of some distances; about 1 where nothing is missing."""
        return float(np.sqrt(np.mean(self.distance[where]**2)))


class Drawn(NamedTuple):
    """Some simulated records, as they are measured."""

    first: int                # number of the first
    statistics: np.ndarray    # (B, S)
    gains: np.ndarray         # (B, d)
    beside: np.ndarray        # (B, S) distances from another simulator, or None

    __repr__ = brief


POSTERIOR_NODES = 24    # parameters that stand for a posterior
TRIALS = 99     # simulated records behind a p-value
MOVED = 48      # simulated records behind a move of indirect inference
MOVES = 24      # moves for a record that readings hide, at most
THERE = 0.2     # standard deviations, some 1 / sqrt(MOVED): a shorter move is none
BOUND = 2.0     # of the first move
FARTHEST = 3.0  # standard deviations along an axis that a refit by slopes goes
LINEAR = 0.1    # share of what a refit by slopes changes by which it may be wrong
LEAST_SHARE = 0.1    # of the variance of a residual: few records fit anything
MIN_WAYS = 40    # simulated records that make an interval of how a gap shrinks
FEWER = (LONG_RECORD, 0.5), (10 * LONG_RECORD, 0.25)    # of these, for more samples


def enough_trials(scene):
    """Simulated records for a record of this length."""
    return int(TRIALS * min([1.0, *(
        part for samples, part in FEWER if len(scene.y) > samples)]))


class _Setting(NamedTuple):
    """What a record and simulated ones have in common on their way to statistics."""

    scene: Scene
    acc: object         # Account
    first: int          # sample from which on they are compared
    own: np.ndarray     # (1, N) the record less what readings hide
    fitted: Scene       # what the fit saw
    late: Scene         # what is compared
    printed: float      # spacing of the digits of the record, too fine for an effect
    misled: bool        # do readings do what the fit knows nothing of?

    def is_like(self, other):
        """Is the same part of the same record compared?"""
        return self.scene is other.scene and self.first == other.first

    def drawn(self, simulator, trials, seed, number=0):
        """Records (trials, N) as they are read, and less what says nothing."""
        scene = self.scene._replace(rounding=0.0) if self.printed else self.scene
        read = simulate_effects(simulator, scene, trials, seed, number).error
        if self.printed:
            read += self.scene.known
            quantize(self.scene, read, self.printed)
            read -= self.scene.known
        return read, without_readings(self.scene, read, self.acc.readings)

    def simulator(self, theta):
        """That of the account at theta, or, all equally probable, at each of several.
        """
        return in_place(as_simulated(self.acc, self.fitted, theta), self.acc,
                        self.fitted)


def distance(scene, acc, trials=None, seed=0, first=0, before=None, near=None):
    """`Gap` of a record to the simulator of an account, put through the same fit.

    The record and `trials` simulated ones are filtered at the posterior mean. Refitting
    each would change a statistic by its regression on the score, the derivative of the
    log-likelihood to the parameters; that is taken away instead, for all alike.

    With `first`, of the samples from that one on, which had no part in the fit: nothing
    is taken away, but the simulated records have parameters drawn from the posterior.
    With `before`, the gap to another simulator, as many simulated records as usual are
    held against that one as well, where these are many. `near` is the gap to a like
    account, if it is known; of this very account, with this seed and `before`, its
    simulated records are the first.
    """
    usual = enough_trials(scene)
    trials = trials or usual
    again = near is not None and near.ruler.fit.setting.acc is acc
    if again:
        (fit, *seen), truth = near.ruler[:3], near.theta
        setting, drawn = fit.setting, list(near.drawn)
    else:
        setting, drawn = _setting(scene, acc, first), []
        fit = _Refit(setting, [] if first else free_columns(acc.member.parameters))
        truth = fit.truth(seed, near)
        seen = _filter_and_probes(setting, near or before)
    fit = fit.prepared()
    simulator = setting.simulator(acc.sample.nodes(POSTERIOR_NODES) if first else truth)
    ruler = _Ruler(fit, *seen)
    real, stats, gain = ruler.laid(scene.y[None], setting.own, True)
    block = fit.block(trials)
    compared = 0 if before is None or usual < MIN_WAYS else usual

    def measured(number):
        read = setting.drawn(simulator, min(block, trials - number), seed, number)
        _, part, gains = ruler.laid(*read)
        return Drawn(number, part.value, gains, before.ruler.measured(read[0])
                     if number < compared else None)
    known = sum(len(part.gains) for part in drawn)
    drawn += side_by_side(measured, range(known, trials, block))
    ruler, null = ruler.marked(np.vstack([part.statistics for part in drawn]),
                               np.vstack([part.gains for part in drawn]), stats)
    d = ruler.distances(stats.value, gain)[0]
    ruler = ruler._replace(fit=fit._replace(shared=None))    # it is long
    stats = stats._replace(value=stats.value[0])
    return Gap(stats, d, null, *p_values(stats.place, ruler.usable, d, null), truth,
               real.z[0, 0], real.log_score[0, 0], ruler, np.vstack(
                   [part.beside for part in drawn if part.beside is not None])
               if compared else None, tuple(drawn))


def p_values(listed, usable, d, null):
    """p-value of every place, and of the whole."""
    result = {}
    for place in PLACES:
        own = (np.array(listed) == place) & usable
        if own.any():
            result[place] = float(_tail(np.abs(d[own]).max(),
                                        np.abs(null[:, own]).max(1)))
    return result, _of_places(result.values())


def _of_places(p):
    """p-value of the whole from those of its places."""
    whole = -np.expm1(len(p) * np.log1p(-min(*p, 1.0 - 1e-15)))
    return float(max(whole, 1e-15))


RESAMPLED = 100    # sets of simulated records


def log_p_error(gap):
    """Standard deviation of the logarithm of a gap's p-value by chance of the simulated
    records, as other sets of these would have it (B. Efron, "Bootstrap methods", Ann.
    Stat. 7, 1979).
    """
    place, usable = np.array(gap.statistics.place), gap.ruler.usable
    own = [(place == name) & usable for name in gap.p_place]
    largest = np.array([np.abs(gap.null[:, part]).max(1) for part in own])
    real = np.array([np.abs(gap.distance[part]).max() for part in own])
    rows = np.random.default_rng(0).integers(len(gap.null), size=(
        RESAMPLED, len(gap.null)))
    each = [_tail(one, null[rows]) for one, null in zip(real, largest)]
    return float(np.std(np.log([_of_places(p) for p in zip(*each)])))


def _setting(scene, acc, first):
    own = without_readings(scene, scene.y[None], acc.readings)
    fitted, late = scene._replace(y=own[0]), scene.cut(slice(first, None))
    if first:
        fitted = scene._replace(y=np.where(np.arange(len(scene.y)) < first, own[0],
                                           np.nan))
    lsb, noise = lattice_and_noise(scene.y + scene.known)
    for r in acc.readings:
        if smoothing := r.smoothing(scene):    # what was rounded before has fine digits
            lsb, noise = np.inf, noise_of(own[0], 0.0) * (
                smoothing.leaves if r.found.variant == ROUNDED else 1.0)
    return _Setting(scene, acc, first, own, fitted, late,
                    lsb if lsb <= COARSE * noise else 0.0,
                    any(misleads(r, noise) for r in acc.readings))


class _Refit(NamedTuple):
    """The fit of an account, for records like that of its scene."""

    setting: _Setting
    free: list               # columns of the parameters that are fitted
    shared: Shared = None    # of all records, if columns are known

    def prepared(self):
        """The same with what all records share."""
        acc, setting = self.setting.acc, self.setting
        if not (self.free and acc.signatures) or acc.member.has_jumps or (
                acc.member.driven):
            return self
        return self._replace(shared=shared(
            acc.member, setting.scene, acc.signatures, self.nodes,
            np.isnan(setting.own[0])))

    def block(self, trials):
        """Of so many simulated records, how many are filtered at once: a mixture filter
        has several for the price of one.
        """
        several = 2 if self.setting.acc.member.has_jumps else 1
        return int(np.clip(several * BLOCK // len(self.setting.scene.y), 1, -(
            -trials // 2)))

    @property
    def nodes(self):
        """Parameters (d + 1, p) at a step in each, and at none."""
        acc = self.setting.acc
        return np.vstack([acc.theta + np.diag(self.step)[self.free], acc.theta])

    @property
    def step(self):
        """Half a posterior standard deviation (p,), to the side within the prior."""
        acc = self.setting.acc
        step = 0.5 * acc.sample.sd(acc.theta)
        high = [p.high for p in acc.member.parameters]
        return np.where(acc.theta + step < high, step, -step)

    def gains(self, masked):
        """Gain (R, d) of a step in every parameter."""
        if not self.free:
            return np.zeros((len(masked), 0))
        acc, known = self.setting.acc, self.shared
        if known is not None and (np.isnan(masked) == known.gap).all():
            ll = known.log_likelihoods(masked)
        else:
            ll = filtered(acc.member, self.setting.scene, acc.signatures, self.nodes,
                          masked)
        return ll[:, :-1] - ll[:, -1:]

    def truth(self, seed, near):
        """Parameters (p,) whose records give this fit; those of the simulator of a gap
        `near` were as far from their fit.

        The fit ignores what coarse rounding and clipping do beyond a further white
        noise: indirect inference (C. Gourieroux, A. Monfort, E. Renault, J. Appl.
        Econometrics 8, 1993). What the record does not
        tell, the prior keeps in place. Under a third of clipped samples the fit is
        dozens of its own standard deviations off, and tells less of a change than of
        itself: slopes are learnt on the way, and moves grow where they help.
        """
        acc, free = self.setting.acc, self.free
        truth, starts = acc.theta.copy(), [acc.theta[free]]
        if not free or not self.setting.misled:
            return truth
        if near is not None:
            like = near.ruler.fit.setting.acc
            apart = dict(zip(like.member.keys, near.theta - like.theta))
            shift = np.array([apart.get(key, 0.0) for key in acc.member.keys])[free]
            if shift.any():
                starts.append(np.maximum(0.5 * starts[0], starts[0] + shift))
        step, fit = self.step[free], acc.theta[free]
        width = np.array([p.high - p.low for p in acc.member.parameters])[free]
        prior, (real,) = np.diag(12.0 * (step / width)**2), self.gains(self.setting.own)
        moved = MOVED * enough_trials(self.setting.scene) // TRIALS
        block = self.block(moved)

        def missed(at):
            """Gains of simulated records over that of the real one, and their slopes
            at the truth, as far as is known.
            """
            truth[free] = at
            # with the same noises, or it would walk about
            simulator = self.setting.simulator(truth)
            s = _without_tails(np.vstack(side_by_side(lambda number: self.gains(
                self.setting.drawn(simulator, min(block, moved - number), seed + 100,
                                   number)[1]), range(0, moved, block))))
            return s.mean(0) - real + prior @ ((at - fit) / step), (
                prior + np.cov(s.T).reshape(len(free), -1))
        # one outside of its ranges is another simulator
        ends = np.array([(p.low, p.high) for p in acc.member.parameters])[free].T
        truth[free] = _root(missed, starts, step, MOVES, ends)
        return truth


def _root(missed, starts, step, moves, ends=(-np.inf, np.inf)):
    """Where `missed` (d,), of which it gives slopes (d, d) by steps as well, is about
    zero, between two ends: C. G. Broyden's method (Math. Comp. 19, 1965), from the best
    point so far.
    """
    def length(off, metric):
        try:
            square = off @ np.linalg.solve(metric, off)
        except np.linalg.LinAlgError:    # nothing tells one simulator from another
            return np.inf
        return np.sqrt(square) if np.isfinite(square) else np.inf    # no such simulator
    starts = [np.clip(at, *ends) for at in starts]
    best, at_best, metric = min(((at, *missed(at)) for at in starts),
                                key=lambda one: length(*one[1:]))
    slope, least, bound = metric, length(at_best, metric), BOUND
    for _ in range(moves):
        if not THERE <= least < np.inf or bound < THERE:
            break
        move = -np.linalg.pinv(slope) @ at_best
        taken = np.sqrt(move @ metric @ move)
        if not taken > 0.0:    # nowhere to go
            break
        move *= min(1.0, bound / taken)
        at = np.clip(np.maximum(best + move * step, 0.5 * best), *ends)
        moved = (at - best) / step
        if not moved.any():
            break
        off, _ = missed(at)
        slope = slope + np.outer(off - at_best - slope @ moved, moved) / (moved @ moved)
        missing = length(off, metric)
        if missing == np.inf:
            break
        if missing < least:
            best, at_best, least = at, off, missing
            bound *= 2.0
        else:
            bound = 0.5 * min(bound, taken)
    return best


def _uncorrelated(s, spread):
    """Axes (d, a) along which gains s (B, d) of mean 0 and standard deviations `spread`
    (d,) are uncorrelated, of variance 1: those of their correlations, as each has a
    unit of its own; without those along which there is nothing.
    """
    sd = np.maximum(spread, 1e-150)
    variance, axes = np.linalg.eigh((s / sd).T @ (s / sd) / (len(s) - 1))
    own = variance > 1e-6
    return axes[:, own] / np.sqrt(variance[own]) / sd[:, None]


def _without_tails(s):
    """Gains (B, d) with what lies far out put at three standard deviations: where a
    filter takes one level for the other, one record would outweigh all others.
    """
    middle = np.median(s, 0)
    sd = 1.4826 * np.median(np.abs(s - middle), 0)
    return np.clip(s, middle - 3.0 * sd, middle + 3.0 * sd)


class _Ruler(NamedTuple):
    """What turns a record into distances from a simulator."""

    fit: _Refit
    filter: Filter               # of the account; None where it has jumps
    probes: Probes
    usable: np.ndarray = None      # (S,) statistics that exist for all records
    mean: np.ndarray = None        # (S,) of the simulated records
    sd: np.ndarray = None          # (S,)
    middle: np.ndarray = None      # (d,) mean gain
    spread: np.ndarray = None      # (d,) standard deviation of the gains
    axes: np.ndarray = None        # (d, a) by which gains become uncorrelated, of
                                   # variance 1
    slope: np.ndarray = None       # (a, S) of the statistics on these

    __repr__ = brief

    def laid(self, read, masked, whole=False):
        """`Predicted`, the `whole` or not, statistics and gains of records, as read and
        as masked.
        """
        setting = self.fit.setting
        acc, first = setting.acc, setting.first
        if acc.member.has_jumps:
            part = predict_first(acc.member, setting.scene, acc.signatures,
                                 self.fit.nodes[::-1], masked, whole)
            gains = part.log_likelihood[:, :0:-1] - part.log_likelihood[:, :1]
        else:
            part = predict(acc.member, setting.scene, acc.signatures, acc.theta[None],
                           masked, whole, self.filter)
            gains = self.fit.gains(masked)
        return part, statistics(part.z[:, 0, first:], read[:, first:], setting.late,
                                self.probes), gains

    def marked(self, T, s, stats):
        """The ruler with its marks, and the distances (B, S) of simulated records of
        statistics T (B, S) and gains s (B, d), of each from all others: D. Belsley,
        E. Kuh, R. Welsch, "Regression Diagnostics", 1980.
        """
        usable = np.isfinite(T).all(0) & np.isfinite(stats.value[0])
        if any(r.moved for r in self.fit.setting.acc.readings):
            usable &= ~stats.of_rounding    # what was added to rounded values hides it
        T = np.where(usable, T, 0.0)    # no two clusters may be without a gap
        B, middle = len(T), s.mean(0)
        spread = s.std(0, ddof=1)
        axes = _uncorrelated(s - middle, spread)
        apart = (s - middle) @ axes
        slope = apart.T @ (T - T.mean(0)) / (B - 1)
        T, moved = T - apart @ slope, LINEAR * apart @ slope
        mean, off = T.mean(0), T - T.mean(0)
        square, free = (off**2).sum(0), max(B - 1.0 - len(slope), 2.0)
        least = np.where(usable, stats.least + 1e-9 * np.abs(stats.value[0]), 1.0)
        # each is off by less than a record that none of these were fitted to
        share = 1.0 - 1.0 / B - (apart**2).sum(1) / (B - 1)
        off /= np.sqrt(np.maximum(share, LEAST_SHARE))[:, None]
        of_others = np.sqrt(np.maximum(square - off**2, 0.0) / (free - 1.0))
        return self._replace(
            usable=usable, mean=mean, sd=np.maximum(np.sqrt(square / free), least),
            middle=middle, spread=spread, axes=axes, slope=slope), np.clip(
                np.sqrt(1.0 + 1.0 / B) * off / np.hypot(
                    np.maximum(of_others, least), moved), -1e3, 1e3)

    def distances(self, T, s):
        """Distances (R, S) of other records; a refit moves no parameter, and along no
        axis, further than FARTHEST.
        """
        within = FARTHEST * self.spread
        apart = np.clip(s - self.middle, -within, within) @ self.axes
        apart = np.clip(apart, -FARTHEST, FARTHEST)
        moved = apart @ self.slope
        T = np.where(self.usable, T, 0.0) - moved
        return np.clip((T - self.mean) / np.hypot(self.sd, LINEAR * moved), -1e3, 1e3)

    def distances_of(self, z):
        """Distances (S,) of the real record if its normal scores were z (N,)."""
        setting = self.fit.setting
        first = setting.first
        stats = statistics(z[None, first:], setting.scene.y[None, first:], setting.late,
                           self.probes)
        return self.distances(stats.value, self.middle[None])[0]

    def measured(self, read):
        """Distances (R, S) of records as they are read."""
        setting = self.fit.setting
        masked = without_readings(setting.scene, read, setting.acc.readings)
        _, stats, gains = self.laid(read, masked)
        return self.distances(stats.value, gains)


def _filter_and_probes(setting, like):
    """The `Filter` of an account, None where it has jumps, and `Probes` of the record
    through that without these; `like` is another gap of the record, or None.
    """
    acc, scene, gap = setting.acc, setting.scene, np.isnan(setting.own[0])
    _, hypotheses = gaussian(scene._replace(y=setting.own[0]), acc)
    h = hypotheses[acc.best]
    own = filter_of(h, scene, acc.signatures, acc.member.matching(h, acc.theta), gap)
    same = like is not None and like.ruler.fit.setting.is_like(setting)
    return None if acc.member.has_jumps else own, probes(
        setting.late, own, setting.first, like.ruler.probes if same else None)


def _tail(largest, null):
    """p-value of a maximum among others (..., B): Gumbel's law."""
    # all may be the same: none of the records has what some count
    scale = np.maximum(np.std(null, axis=-1, ddof=1), 1e-9) * np.sqrt(6.0) / np.pi
    e = (largest - np.mean(null, axis=-1)) / scale + np.euler_gamma
    return np.maximum(-np.expm1(-np.exp(-e)), 1e-15)
