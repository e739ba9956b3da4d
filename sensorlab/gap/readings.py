"""What readings do to a record is seen in the values themselves."""

from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.interpolate import BSpline
from scipy.optimize import minimize, nnls
from scipy.special import erf, gammaln, log_ndtr, logsumexp, ndtr, ndtri, xlogy

from sensorid import brief
from sensorlab.gap.averages import FEWEST_TAPS, FEWEST_TURNS, averaged_over, undone
from sensorlab.gap.catalogue import CATALOGUE, taps_of
from sensorlab.gap.clipping import unclipped
from sensorlab.gap.effects import Found, Scene
from sensorlab.gap.values import (
    CERTAIN, EXACT, FEWEST, SMOOTH_OVER, TELLING, beside, interpolated, lattice,
    lattice_between, more_than_chance, noise_where_calm, on_samples, repeated_at_random,
    runs, snapped, spread_where_calm, within)


class Reading(NamedTuple):
    """An effect of the reading that a record shows."""

    found: Found         # its values: lsb, limits, spans, or rate and phase
    log_bayes: float     # a continuous simulator never repeats a value
    masked: np.ndarray   # (N,) samples that say nothing of the rest
    opaque: bool         # it hides what else there may be
    coarse: bool = False    # it adds no white noise, but what hangs on the value
    moved: bool = False  # something was added to the record after it was rounded
    instead: "Reading" = None    # of the simulator's own, whose value is wrong
    factor: float = 1.0          # by which it is

    __repr__ = brief

    @property
    def placed(self):
        """Does what it does hang on where the record lies?"""
        return self.coarse or not {"limits", "codes"}.isdisjoint(self.found.values)

    @property
    def is_average(self):
        """Is it a moving average?"""
        return "window" in self.found.values

    @property
    def beyond(self):
        """Are limits wrong, as the record goes beyond them?"""
        return bool(self.instead) and "limits" in self.found.values

    @property
    def does_something(self):
        """Does it alter any value?"""
        values = self.found.values
        return values.get("lsb", 1.0) > 0.0 and bool(
            np.isfinite(values.get("limits", 0.0)).any())


COINCIDENCE = 23.0    # nats: what one repeated value in double precision is worth,
                      # about ln(1e10 distinguishable values in the noise)
TAIL = 4              # values next to the last one, of which the fullest counts
FEWEST_CODES = 4      # of a lattice: how often three are met, a normal law may explain
COARSE = 0.1          # of the white noise: a finer lattice is how a file was printed
HIDDEN = 0.25         # of the samples: if more are clipped, what they may have been
                      # says too little
NOISY = 2.0           # of the white noise: what a coarser lattice adds is no white
                      # noise (B. Widrow, I. Kollar, "Quantization Noise", 2008)
HIDING = 4.0          # of the white noise: of a coarser lattice few codes are met,
                      # and these for long, unless ...
SOON = 16             # ... samples later many have been passed: what is slow is smooth
SMOOTH = 1.5          # of the white noise: what a finer lattice adds is white noise to
                      # exp(-2 pi^2 / 1.5^2) = 2e-4 of it (the same)


ROUNDING = 1e-9       # of the white noise: equal but for rounding


def readings(scene):
    """Quantization, uneven codes, saturation, repeated and stuck samples of a record
    from which nothing was taken away, or a moving average, as a tuple of Reading.
    """
    y, N, seen = scene.y, len(scene.y), []
    between = interpolated(y)
    taps, log_bayes = averaged_over(y) if not between.every else (0, 0.0)
    if taps:    # of what was read before it, no value but the counts shows anything
        average = Reading(_found("moving_average", window=taps * scene.dt), log_bayes,
                          np.zeros(N, bool), False)
        lsb, y = taps * lattice(y), undone(y, taps)
        return average, *_rounded(y, lsb, _noise(y, lsb))
    own = _own_rate(y)
    if own:
        rate, phase, repeated = own
        seen.append(Reading(_found("repeated_samples", frequency=rate / scene.dt,
                                   phase=2.0 * np.pi * phase),
                            COINCIDENCE * float(repeated.sum()), repeated, False))
    else:
        repeated = repeated_at_random(y)
        if repeated.any():
            rate = float(1.0 - repeated.mean()) / scene.dt
            seen.append(Reading(_found("repeated_samples", frequency=rate, phase=None),
                                COINCIDENCE * float(repeated.sum()), repeated, False))
    y = np.where(repeated, np.nan, y)
    if between.own.any():
        rate, phase = 1.0 - float(between.own.mean()), None
        if between.every:
            rate = 1.0 / between.every
            phase = 2.0 * np.pi * ((0.5 - between.first) * rate % 1.0)
        seen.append(Reading(_found("interpolated_samples", frequency=rate / scene.dt,
                                   phase=phase, order=between.order),
                            COINCIDENCE * float(between.own.sum()), between.own, False))
        y = np.where(between.own, np.nan, y)
    lsb, noise = lattice_and_noise(y)
    moved = lattice_between(y) if not lsb else 0.0
    if moved:
        lsb, noise = moved, less_rounding(noise, moved)
    limits, clipped = _clipped(y, lsb, noise)
    spans, stuck = _stuck(y, lsb, noise, clipped)
    if clipped.any():
        seen.append(Reading(_found("saturation", limits=limits),
                            COINCIDENCE * float(clipped.sum()), clipped,
                            bool(clipped.mean() > HIDDEN)))
    if spans:
        spans = [[float(begin * scene.dt), int(n)] for begin, n in spans]
        seen.append(Reading(_found("stuck", spans=spans),
                            COINCIDENCE * float(stuck.sum()), stuck, False))
    counts = _rounded(y, lsb, noise, bool(moved))
    seen += counts
    if counts:
        codes, log_bayes = _codes(y[~(clipped | stuck)], lsb)
        if codes and not moved:
            seen.append(Reading(_found("differential_nonlinearity", codes=codes),
                                log_bayes, np.zeros(N, bool), False))
    return tuple(seen)


def _rounded(y, lsb, noise, moved=False):
    """The `Reading` of rounding to multiples of lsb, if they are not so fine as digits
    that are printed, in a list.
    """
    if lsb <= COARSE * noise:
        return []
    hides = hide(y, lsb, noise)
    return [Reading(_found("quantization", lsb=lsb), COINCIDENCE * len(y),
                    np.zeros(len(y), bool), hides,
                    bool(lsb > NOISY * noise and not hides), moved)]


def hide(y, lsb, noise=None):
    """Do counts hide most of what moves a record between them?"""
    noise = _noise(y, lsb) if noise is None else noise
    return bool(lsb > HIDING * noise and lsb > NOISY * _noise(y, lsb, SOON))


def compared(scene, own, simulated=None):
    """Readings (of Reading) that the simulator has and those that the record shows,
    from those that are said to be its `own` (of Found). What both have is worth 0 nats.

    Where records of the simulator, `simulated` (L, N), are all that is known of it,
    both were rounded by the same sensor: a record that lies on no lattice was added to
    since, and counts may be too fine to show in theirs.
    """
    seen, had = {r.found.name: r for r in readings(scene)}, {}
    measured, rounded = simulated is not None, seen.get("quantization")
    if measured and rounded and all(one.name != "quantization" for one in own) and (
            np.isclose(lattice(np.atleast_2d(simulated)[0]),
                       rounded.found.values["lsb"], rtol=ALIKE)):
        own = (*own, rounded.found)
    for one in own:
        name, shown = one.name, seen.get(one.name)
        mine = Reading(one, 0.0, np.zeros(len(scene.y), bool), False)
        if shown and _alike(one.values, shown.found.values, len(scene.y)):
            had[name] = seen[name] = shown._replace(log_bayes=0.0)
        elif not shown and measured and name == "quantization" and adds_noise(
                scene.y, one.values["lsb"]):
            had[name] = seen[name] = mine._replace(moved=True)
        elif name in NONE and (shown or _would_show(scene, one)):
            new, symbol = shown or mine._replace(
                found=one._replace(values=NONE[name](scene)),
                log_bayes=COINCIDENCE * len(scene.y)), WRONG[name]
            had[name], seen[name] = mine, new._replace(
                instead=mine, factor=new.found.values[symbol] / one.values[symbol])
        elif not shown and name == "saturation" and (wider := _beyond(scene, one)):
            seen[name] = wider._replace(instead=mine)
        elif not shown and name != "stuck":
            had[name] = seen[name] = mine
    return tuple(had.values()), tuple(seen.values())


ALIKE = 0.02    # relative: two counts or limits that are the same
WRONG = dict(quantization="lsb", repeated_samples="frequency",
             interpolated_samples="frequency", saturation="limits",
             moving_average="window")
NONE = dict(    # the values of a reading that does nothing
    quantization=lambda scene: dict(lsb=lattice(scene.y)),
    repeated_samples=lambda scene: dict(frequency=1.0 / scene.dt, phase=np.pi),
    interpolated_samples=lambda scene: dict(frequency=1.0 / scene.dt, phase=np.pi,
                                            order=1),
    moving_average=lambda scene: dict(window=scene.dt))


def _alike(own, seen, samples):
    """Is a reading of the simulator that of a record of so many samples? Where samples
    stick or repeat may differ, and which codes are met; a rate at random is counted.
    """
    at_random = seen.get("phase", 0.0) is None
    rtol = ALIKE + (2.0 / np.sqrt(samples) if at_random else 0.0)
    return all(symbol in ("spans", "phase", "codes", "order")
               or np.allclose(value, seen[symbol], rtol=rtol)
               for symbol, value in own.items())


def _would_show(scene, one):
    """Would a record like that of a scene show a reading of a simulator?"""
    if one.name == "quantization":
        return one.values["lsb"] > COARSE * lattice_and_noise(scene.y)[1]
    if one.name == "moving_average":
        return FEWEST_TAPS * scene.dt <= one.values["window"] <= (
            scene.duration / FEWEST_TURNS)
    return len(scene.y) * (1.0 - one.values["frequency"] * scene.dt) > 2.0 * FEWEST


def _beyond(scene, one):
    """The `Reading` without those limits of a simulator that the record of a scene
    lies beyond, and by which factor at least they are wrong; None if it keeps within.
    """
    limits = np.array(one.values["limits"])
    ends = np.array([np.nanmin(scene.y), np.nanmax(scene.y)])
    over = np.array([-1.0, 1.0]) * (ends - limits) > ROUNDING * scene.white
    if not over.any():
        return None
    beyond = np.sum((scene.y < limits[0]) & over[0] | (scene.y > limits[1]) & over[1])
    with np.errstate(divide="ignore"):
        factor = np.max(np.abs(ends[over] / limits[over]))
    wider = np.where(over, [-np.inf, np.inf], limits).tolist()
    return Reading(one._replace(values=dict(limits=wider)), COINCIDENCE * float(beyond),
                   np.zeros(len(scene.y), bool), False, factor=float(factor))


def missing(r):
    """What a simulator lacks that has not a reading which the record shows, or has it
    with a wrong value, as `Found`.
    """
    one, values = r.found, r.found.values
    if r.instead:
        one = one._replace(effect=one.effect._replace(name="wrong_parameter"))
        values = dict(parameter=f"{r.found.name}.{WRONG[r.found.name]}",
                      factor=r.factor)
    return one._replace(values={
        symbol: (value, 0.0) for symbol, value in values.items()})


def _found(name, **values):
    return Found(CATALOGUE[name], values=values)


def lattice_and_noise(y):
    """`lattice` of a record, and the standard deviation of its noise without it."""
    lsb = lattice(y)
    return lsb, _noise(y, lsb)


def recorded(y, dt, columns):
    """`Scene` of a record (N,) and its columns as they were recorded."""
    lsb, noise = lattice_and_noise(y)
    largest = _spacing_of_largest(y)
    if lsb < largest <= COARSE * noise:    # what is small was rounded by less: a noise
        lsb, y = largest, largest * np.round(y / largest)    # that changes
    return Scene(on_samples(snapped(y)), dt, columns,
                 rounding=lsb / np.sqrt(12.0) if lsb <= COARSE * noise else 0.0)


MOST_DIGITS = 8    # that are few
FEW_LARGEST = 8    # values that lie on their spacing by chance once in 10^8


def _spacing_of_largest(y):
    """Spacing of the largest values of a record that was printed with the same few
    significant digits for all, or 0.
    """
    size = np.abs(y[~np.isnan(y) & (y != 0.0)])
    for digits in range(2, MOST_DIGITS + 1):
        for some in size[:FEW_LARGEST**2], size:    # a long one of doubles is told soon
            spacing = 10.0**(np.floor(np.log10(some)) + 1 - digits)
            codes = some / spacing
            if (np.abs(codes - np.round(codes)) >= EXACT).any():
                break
        else:
            return float(np.sort(spacing)[-min(FEW_LARGEST, len(spacing))])
    return 0.0


def _noise(y, lsb, apart=1):
    """Standard deviation of what is another in samples so many `apart`, without what
    rounding adds.
    """
    seen = y[~np.isnan(y)]
    return less_rounding(np.sqrt(np.mean((seen[apart:] - seen[:-apart])**2) / 2.0), lsb)


def adds_noise(y, lsb):
    """Is rounding to multiples of lsb about a further white noise for a record that
    lies on no lattice, or does it hide more?
    """
    _, noise = lattice_and_noise(y)
    return bool(lsb <= NOISY * less_rounding(noise, lsb))


def less_rounding(noise, lsb):
    """Standard deviation of a noise without what rounding adds."""
    return np.sqrt(np.maximum(noise**2 - lsb**2 / 12.0, 0.0))


def misleads(reading, noise):
    """Does a reading more than leave out samples and add a white noise to one that is
    there? Then the fit is off.
    """
    values = reading.found.values
    return "limits" in values or values.get("lsb", 0.0) > SMOOTH * noise


def _clipped(y, lsb, noise):
    """Limits, infinite where there is none, and the samples (N,) that lie on one: the
    last value is met far more often than a tail allows. Few counts have no tail.
    """
    seen = y[~np.isnan(y)]
    clipped, limits = np.zeros(len(y), bool), []
    if np.ptp(seen) < (FEWEST_CODES - 1.5) * lsb:
        return [-np.inf, np.inf], clipped
    for sign in (-1.0, 1.0):
        end = sign * np.max(sign * seen)
        # on a lattice, a few far out may meet on one value: what is next to it counts
        near = [*sign * np.unique(sign * seen)[-TAIL - 1:-1], *(
            end - sign * k * lsb for k in range(1, TAIL + 1) if lsb)]
        before = max(np.sum(np.abs(y - v) <= 0.5 * lsb) for v in near)
        least = 3 if lsb < COARSE * noise else 3 * TAIL
        at_end = y == end
        count = np.sum(at_end)
        # where others do not come again, none does by chance; it may stick once
        others = seen[seen != end]
        full = not lsb and count >= least and np.sum(np.diff(at_end)) > 3 and (
            2 * len(np.unique(others)) > len(others))
        full = full or count >= least + 2.0 * before + 6.0 * np.sqrt(before) or (
            lsb > 0.0 and count >= least and (
                lsb >= COARSE * noise and _piles_up(np.abs(end - seen) / lsb)
                or _ends_abruptly(np.abs(end - seen), lsb)
                and not _codes(seen[seen != end], lsb)[0]))
        full = full and _is_near(end, seen, lsb)
        limits.append(float(end) if full else sign * np.inf)
        clipped |= at_end & full
    return limits, clipped


ABRUPT = 14.0        # nats, by which a record is unlikely to end as it does
SPAN = 8.0           # standard deviations that a noise has
PREDICTED_BY = 16    # samples before, that tell the white noise of a record


def _ends_abruptly(apart, lsb):
    """Are there so many samples on the last code of a lattice that there ought to be
    others beyond? Samples are `apart` (N,) from it.

    What cannot be predicted is normal, of standard deviation s at least. If n of N
    samples are on the code, it lies D s at most above what is predicted, the normal
    quantile of 1 - n / N, and beyond it r n are to be expected at least, r the sum of
    exp(-D x - x^2 / 2), x in units of s; a code may be half as wide again. That n are
    on it and none beyond has at most the probability (1 + r)^-n, whatever was to be
    expected there.
    """
    left = _unpredicted(apart[:TELLING])
    if left is None:
        return False
    noise = less_rounding(np.std(left), lsb)
    on = apart < 0.5 * lsb
    count = on[0] + np.sum(on[1:] & ~on[:-1])    # what is slow rests there
    if not noise or not count:
        return False
    x = lsb / noise * (np.arange(1, int(SPAN * noise / lsb) + 2) + 0.5)
    above = -ndtri(0.5 * count / len(apart))
    return count * np.log1p(np.exp(-above * x - 0.5 * x**2).sum()) > ABRUPT


def _unpredicted(y):
    """What those PREDICTED_BY before do not foretell of samples, by least squares; None
    if there are too few of them.
    """
    rows = np.lib.stride_tricks.sliding_window_view(y, min(PREDICTED_BY + 1, len(y)))
    if len(rows) < 4 * PREDICTED_BY:
        return None
    before = np.column_stack([np.ones(len(rows)), rows[:, :-1]])
    return rows[:, -1] - before @ np.linalg.lstsq(before, rows[:, -1])[0]


APART = 5.0    # standard deviations of the noise: what is farther out was never clipped


def _is_near(end, seen, lsb):
    """Do other values of a record come near its end? If not, that is what a logger
    writes where it has no value.
    """
    others = seen[seen != end]
    noise = np.sqrt(np.mean(np.diff(others)**2) / 2.0) if len(others) > 1 else 0.0
    return np.abs(end - others).min(initial=np.inf) <= max(APART * noise, 1.5 * lsb)


FEWEST_NEXT, MOST_NEXT = 4, 8    # codes next to the last one, that foretell it
PILED = 4.0    # standard deviations by which there is more than they foretell


def _piles_up(apart):
    """Is the last code of a lattice met more often than those next to it foretell?

    Samples are so many codes `apart` (N,) from it. Roots of counts have one variance,
    or more if codes are of uneven width (F. J. Anscombe, Biometrika 35, 1948); up to
    the fullest code a parabola foretells them, or a line if they are few.
    """
    near = np.round(apart[apart < 2 * MOST_NEXT]).astype(int)
    count = np.bincount(near, minlength=FEWEST_NEXT)
    root, own = np.sqrt(count + 0.375), np.arange(
        1, min(MOST_NEXT, count[1:].argmax() + 1) + 1)
    if len(own) < FEWEST_NEXT:
        return False
    powers = np.vander(own, 3 if len(own) > FEWEST_NEXT + 1 else 2, increasing=True)
    inverse = np.linalg.inv(powers.T @ powers)
    fit = inverse @ (powers.T @ root[own])
    off = root[own] - powers @ fit
    variance = max(0.25, off @ off / (len(own) - len(fit)))
    foretold = max(fit[0], np.sqrt(0.375))
    return root[0] - foretold > PILED * np.sqrt(variance * (1.0 + inverse[0, 0]))


def latent_mean(y, seen):
    """Mean of a record before it was clipped, or rounded to a coarse lattice, if any of
    the `Reading` does that, else None: the most likely one if its values are normal
    (J. Tobin, Econometrica 26, 1958).
    """
    limits = [r.found.values["limits"] for r in seen if "limits" in r.found.values]
    coarse = [r.found.values["lsb"] for r in seen if r.coarse]
    if not limits and not coarse:
        return None
    return latent_law(y, (limits or [(-np.inf, np.inf)])[0], (coarse or [0.0])[0])[0]


def latent_law(y, ends, lsb):
    """Mean and standard deviation that the values of a record most likely had before
    they were clipped at two ends and rounded to a lattice, if they are normal.
    """
    half, y = 0.5 * lsb, y[~np.isnan(y)]
    inside = y[(y > ends[0]) & (y < ends[1])]
    clipped = [(sign, end, np.sum(sign * (y - end) >= 0.0))
               for sign, end in zip((-1.0, 1.0), ends) if np.isfinite(end)]
    start = inside if len(inside) > 1 and np.ptp(inside) else y
    value, count = np.unique(inside, return_counts=True)

    def misfit(at):
        mean, sigma = at[0], np.exp(at[1])
        z = np.abs(value - mean) / sigma
        if half:
            law = np.log(ndtr(half / sigma - z) - ndtr(-half / sigma - z) + TINY)
        else:
            law = -0.5 * z * z - at[1]
        return -count @ law - sum(number * log_ndtr(sign * (mean - end) / sigma)
                                  for sign, end, number in clipped)
    mean, log_sigma = minimize(misfit, [start.mean(), np.log(start.std())],
                               method="Nelder-Mead").x
    return float(mean), float(np.exp(log_sigma))


TINY = 1e-300    # a probability that has a logarithm


REGULAR = 0.75     # of the samples that a rate repeats are equal, if it is one: which
                   # is repeated where both meet may be chance
ALWAYS = 0.95      # the same, where counts are coarser than the noise
HARMONICS = 3      # of the rate that the largest line may be
A_LINE = 3.0       # nats that a line has over the largest of noise
MOST_TIES = 20000  # in which a rate is sought
ONE_TURN = 1e-7    # turns: one and the same
FINE = 20          # parts of the arc to which a rate is found over the record


def _own_rate(y):
    """Rate of a sensor that is polled faster, in its samples per sample, its phase, and
    the repeated samples (N,); None if there is none.

    Sample i is repeated where the fractional part of rate i + phase is above the rate:
    an arc. The rate has a line in the spectrum of the ties. What repeats by chance is
    as often outside of the arc.
    """
    N = len(y)
    same = np.append(False, np.diff(y) == 0.0)
    ties, p = np.flatnonzero(same), same.mean()
    if len(ties) < FEWEST:
        return None
    n = next_fast_len(4 * N, real=True)
    power = np.abs(np.fft.rfft(same - p, n)[4:])**2 / (N * p * (1.0 - p) + 1e-9)
    if power.max() < np.log(N) + A_LINE:
        return None
    strong = np.flatnonzero(power > 0.5 * power.max())[[0, -1]]    # of its harmonics
    every = -(-len(ties) // MOST_TIES)
    ties = ties[::every]
    lines = (4 + np.append(strong, power.argmax())) / n
    rate = max((_nearest(ties, r, N / every, N, 0.5, 21)
                for line in lines for k in range(1, HARMONICS + 1)
                for r in (line / k, 1.0 - line / k)))[1]
    finer = np.clip(int(1.0 / (1.0 - rate)), 1, FINE)
    _, rate = _nearest(ties, rate, N / every, N, 0.1, FINE * finer)
    middle = _arc(ties, rate)[1]
    away = (rate * np.arange(N) - middle + 0.5) % 1.0 - 0.5
    arc = np.abs(away) < 0.5 * (1.0 - rate)
    repeated = same & arc
    gain = (_log_likelihood(same[arc]) + _log_likelihood(same[~arc])
            - _log_likelihood(same))
    lsb, noise = lattice_and_noise(y[~repeated])
    left = _unpredicted(y[~np.isnan(y)][:TELLING])
    if (gain < CERTAIN + 2.0 * np.log(N)
            or same[arc].mean() < (ALWAYS if lsb > noise else REGULAR)):
        return None
    # what moves steadily through coarse counts is regular, too; nothing new is repeated
    if lsb and (left is None or lsb > NOISY * less_rounding(
            np.std(left) / np.sqrt(rate), lsb)):
        return None
    if not lsb:    # none repeats by chance: what a clock that is not even repeats
        for begin, n in zip(*runs(same)):
            repeated[begin:begin + n] |= n <= np.ceil(1.0 / rate)
    return float(rate), float((0.5 * (1.0 + rate) - middle) % 1.0), repeated


def _log_likelihood(same):
    """Largest log-likelihood of independent ties."""
    p = np.sum(same) / max(len(same), 1)
    return len(same) * (xlogy(p, p) + xlogy(1.0 - p, 1.0 - p))


def _arc(ties, rate):
    """How many ties lie in the arc of the repeated samples at a rate, wherever most do,
    and its middle, in turns. Their mean direction would be off by those by chance.
    """
    turns = np.sort(rate * ties % 1.0)
    around = np.append(turns, turns + 1.0)
    # the arc is open: at a rate of 1/k both ends are samples
    last = np.searchsorted(around, turns + 1.0 - rate - ONE_TURN)
    count = last - np.arange(len(turns))
    k = count.argmax()
    return count[k], 0.5 * (turns[k] + around[last[k] - 1])


def _nearest(ties, rate, samples, N, reach, count):
    """By how much more ties than other samples, of so many in all, lie in the arc of
    the best of so many rates, so many turns in N samples about one; and the middle of
    the best rates.
    """
    rates = rate + np.linspace(-reach, reach, count) / N
    inside = np.array([_arc(ties, r)[0] for r in rates])
    score = 2.0 * inside - samples * (1.0 - rates)
    return score.max(), np.mean(rates[inside == inside[score.argmax()]])


def _stuck(y, lsb, noise, clipped):
    """Runs (first sample, length) of equal values longer than chance, and the samples
    (N,) of them but the first, which is a reading.
    """
    same = np.append(False, np.diff(y) == 0.0) & ~clipped
    start, length = runs(same)
    # what a part of the record, or neighbours, lie on is no lattice of it
    tie = _stays(lsb, noise) if lsb else _tie_by_chance(start, length, len(y))
    own = length >= more_than_chance(tie, len(y))
    start, length = start[own], length[own]
    while lsb and len(start):    # noise, and counts, may change: those nearby tell
        noise, ties = _nearby(y, start, length)
        tie = np.maximum(_stays(lsb, less_rounding(noise, lsb)), ties)
        own = length >= more_than_chance(tie, len(y))
        if own.all():
            break
        start, length = start[own], length[own]
    spans = list(zip(start - 1, length + 1))
    return spans, within(start, length, len(y))


def _stays(lsb, noise):
    """Probability that a value in the middle of its cell stays there by chance; 1 where
    the noise does not tell.
    """
    return np.where(lsb < 2.0 * noise, erf(
        lsb / np.maximum(2.0 * np.sqrt(2.0) * noise, lsb)), 1.0)


def _nearby(y, start, length):
    """Standard deviations of the white noise next to runs of equal values of that first
    sample and length, where it is calmer: before or behind them, the runs left out; and
    the share of samples there that equal the last, where it is larger.
    """
    step = np.abs(np.diff(y, prepend=np.nan))
    same = np.where(np.isnan(step), np.nan, step == 0.0)
    return (np.minimum(*beside(step, start, length, np.inf)) * np.sqrt(np.pi) / 2.0,
            np.maximum(*beside(same, start, length, 0.0)))


def _tie_by_chance(start, length, samples):
    """Probability that a sample equals the last by chance, where runs of equal ones
    are: it is that a single tie goes on, and one over how far it is to the next.
    """
    once, twice = start[length == 1], np.sum(length == 2)
    if FEWEST <= twice < len(once):
        return twice / len(once)
    if len(once) <= 2:
        return len(once) / samples
    # half of the distances are beyond the median; there are parts without ties, too
    return 1.0 - 0.5**(1.0 / np.median(np.diff(once)))


MOST_CODES = 1000    # about the median, that are looked at
FEW_CODES = 100      # if noise is over few of them
FAR = 0.001          # of the samples, at either end, that are not
UNEVEN = np.geomspace(1.0, 100.0, 17)    # 1 / variance of widths, in lsb^2


def _codes(y, lsb):
    """Codes [value, width] of a converter, and the log odds that their widths are not
    all the same; [] if nothing speaks for it.

    A code is met the more often the wider it is (J. Doernberg, H.-S. Lee, D. A. Hodges,
    "Full-speed testing of A/D converters", IEEE J. Solid-State Circuits 19, 1984), and
    noise over several codes makes the law of the values smooth, whatever else is in
    them: counts are Poisson about it, or about it times widths of a gamma law. Noise
    over few codes must be nearly normal for that.
    """
    y = y[~np.isnan(y)]
    smooth_over, noise = noise_where_calm(y) >= SMOOTH_OVER * lsb, 0.0
    if not smooth_over:
        noise = _least_noise(y, lsb) / lsb
        if noise < 1.0 / NOISY:
            return [], 0.0
    first, middle, last = np.quantile(y, [FAR, 0.5, 1.0 - FAR], method="nearest")
    reach = lsb * ((MOST_CODES if smooth_over else FEW_CODES) // 2)
    near = y[(y >= max(first, middle - reach)) & (y <= min(last, middle + reach))]
    first = near.min()
    count = np.bincount(np.round((near - first) / lsb).astype(int))
    smooth = _smooth_law(count) if smooth_over else _mixed_law(count, noise)
    scale = UNEVEN[:, None]
    gain = (gammaln(scale + count) - gammaln(scale) + scale * np.log(scale)
            - (scale + count) * np.log(scale + smooth) + smooth).sum(1)
    log_bayes = logsumexp(gain) - np.log(len(gain))
    if log_bayes < CERTAIN:
        return [], 0.0
    best = UNEVEN[gain.argmax()]
    width = (best + count) / (best + smooth)
    # a code ends where as much of the smooth law lies below as its width says
    below = np.cumsum([0.0, *smooth])
    own = np.cumsum([0.0, *width * smooth])
    ends = np.interp(own * below[-1] / own[-1], below, np.arange(len(below)))
    return np.column_stack([first + lsb * np.arange(len(count)),
                            lsb * np.diff(ends)]).tolist(), float(log_bayes)


NORMAL = 0.8    # of the standard deviation of the noise, at least, that is normal


def _least_noise(y, lsb):
    """Standard deviation of a normal noise that every sample has at least, whatever was
    before: in the calmest parts, of what cannot be foretold and of what is new.
    """
    left = _unpredicted(y[:TELLING])
    if left is None:
        return 0.0
    noise = min(spread_where_calm(left), noise_where_calm(y))
    return NORMAL * less_rounding(noise, lsb)


REWEIGHTED = 30    # times, until the most likely law is found
TILTED = 4         # powers of the value in the logarithm of what makes a law another


def _mixed_law(count, noise):
    """Expected counts (n,) of codes under the most likely law that a normal noise of so
    many codes allows: any mixture of such (N. Laird, "Nonparametric maximum likelihood
    estimation of a mixing distribution", J. Am. Stat. Assoc. 73, 1978), tilted, as a
    noise may be a little skewed, or have tails.
    """
    n = len(count)
    middle = np.arange(-2.0 * noise, n - 1.0 + 2.5 * noise, 0.5 * noise)
    ends = (np.arange(n + 1)[:, None] - 0.5 - middle) / noise
    share, law = np.diff(ndtr(ends), axis=0), np.maximum(count, 1.0)
    for _ in range(REWEIGHTED):    # least squares in the variances of Poisson counts
        weight = nnls(share / np.sqrt(law)[:, None], count / np.sqrt(law))[0]
        law, last = np.maximum(share @ weight, 0.01), law
        if np.abs(law - last).max() < 0.01 * np.sqrt(law.max()):
            break
    return _fitted(count, np.polynomial.legendre.legvander(
        np.linspace(-1.0, 1.0, n), TILTED), np.zeros(TILTED + 1), law)


def _smooth_law(count):
    """Expected counts (n,) of codes under a law whose logarithm is a cubic spline with
    knots SMOOTH_OVER codes apart.
    """
    n = len(count)
    knots = np.linspace(-0.5, n - 0.5, 2 + int(n / SMOOTH_OVER))
    basis = BSpline.design_matrix(np.arange(float(n)), np.pad(knots, 3, mode="edge"),
                                  3).toarray()
    return _fitted(count, basis, np.linalg.lstsq(basis, np.log(count + 0.5))[0])


def _fitted(count, basis, at, law=1.0):
    """The most likely law (n,) of Poisson counts that is another, in its logarithm, by
    a sum of a basis (n, k), whose coefficients are near `at`.
    """
    for _ in range(NEWTON_STEPS):
        own = law * np.exp(basis @ at)
        slope = basis.T @ (count - own) - FLAT * at
        at += np.linalg.solve(basis.T @ (own[:, None] * basis)
                              + FLAT * np.eye(len(at)), slope)
    return law * np.exp(basis @ at)


NEWTON_STEPS = 20
FLAT = 1e-3    # weight of a prior of the coefficients: where nothing was counted


def as_read(full, seen):
    """A scene less what readings hide, with what clipped samples may have been, unless
    readings hide that, too.
    """
    if not seen:
        return full
    y = without_readings(full, full.y[None], seen)[0]
    for low, high in _limits(full, seen):
        if not any(one.coarse or one.opaque for one in seen):
            clipped = (full.y <= low) | (full.y >= high)
            raw = np.where(clipped, full.y, y) + full.known
            low, high = np.max(low + full.known), np.min(high + full.known)
            y[clipped] = (unclipped(raw, low, high) - full.known)[clipped]
    return full._replace(y=y)


def _limits(scene, seen):
    """Limits (low, high) that readings have, less what is known of a scene."""
    least = ROUNDING * scene.white
    for one in seen:
        if "limits" in one.found.values:
            low, high = (end - scene.known for end in one.found.values["limits"])
            yield low + least, high - least


def without_readings(scene, y, seen):
    """Records (R, N) like that of a scene with NaN where a reading says nothing more of
    the true value.
    """
    y = y.copy()
    for low, high in _limits(scene, seen):
        y[(y <= low) | (y >= high)] = np.nan
    for one in seen:
        if "limits" not in one.found.values:
            y[:, one.masked] = np.nan
    for one in seen:
        if one.is_average:
            y = undone(y, taps_of(scene, **one.found.values))
    return y
