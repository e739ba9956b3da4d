"""What readings do to a record is seen in the values themselves."""

from typing import NamedTuple

import numpy as np

from sensorid import brief
from sensorlab.gap.averages import (
    FEWEST_TAPS, FEWEST_TURNS, Average, as_averaged, averaged_over)
from sensorlab.gap.catalogue import CATALOGUE, ROUNDED, taps_and_times
from sensorlab.gap.clipping import latent_law, limits_of, unclipped
from sensorlab.gap.codes import odds_to_even, uneven_codes
from sensorlab.gap.dropouts import dropouts
from sensorlab.gap.effects import Found, Scene
from sensorlab.gap.integrated import counts_of_integral, is_no_integral
from sensorlab.gap.interpolated import interpolated, on_samples
from sensorlab.gap.repeats import repeated, stuck_spans
from sensorlab.gap.resampled import less_resampling
from sensorlab.gap.steep import (
    FEWEST_SAMPLES, HIGHEST, Steep, filled, log_odds_of_another, steep_low_pass)
from sensorlab.gap.unaveraged import undone, weights
from sensorlab.gap.values import (
    CERTAIN, COARSE, EXACT, FEWEST, NOISY, lattice, lattice_and_noise, lattice_between,
    less_rounding, noise_of, runs, snapped)


class Reading(NamedTuple):
    """An effect of the reading that a record shows."""

    found: Found         # its values: lsb, limits, spans, or rate and phase
    log_bayes: float     # a continuous simulator never repeats a value
    masked: np.ndarray   # (N,) samples that say nothing of the rest
    opaque: bool         # it hides what else there may be
    coarse: bool = False    # it adds no white noise, but what hangs on the value
    moved: bool = False  # something was added to the record after it was rounded
    counts: float = 0.0  # that an average was rounded to, as `averages.Average` has it
    white: tuple = None  # what a simulator says of white noise, as `filled` takes it
    instead: "Reading" = None    # of the simulator's own, whose value is wrong
    factor: float = 1.0          # by which it is

    __repr__ = brief

    @property
    def placed(self):
        """Does what it does hang on where the record lies?"""
        return self.coarse or not {"limits", "codes"}.isdisjoint(self.found.values)

    @property
    def cell(self):
        """Spacing of cells, in one of which every value lay before it was rounded to
        it; 0 if it is none of these.
        """
        values = self.found.values
        return values.get("lsb", 0.0) if self.found.name != INTEGRAL else 0.0

    def smoothing(self, scene):
        """Its `Smoothing` of records like that of a scene; None if it is none."""
        values = self.found.values
        if "window" in values:
            window = taps_and_times(scene, **values)
            return Smoothing(lambda y: undone(y, *window, self.counts),
                             np.linalg.norm(weights(*window)))
        if "cutoff" in values:
            cutoff, poles = values["cutoff"] * scene.dt, values["poles"]
            return Smoothing(lambda y: filled(y, cutoff, poles, self.white),
                             np.sqrt(2.0 * cutoff))
        return None

    def as_white_as(self, simulator):
        """The same with what the simulator says of white noise."""
        sigma = [p for h, _ in simulator.pairs for p in h.parameters
                 if p.symbol == "sigma_v"]
        white = sigma and (min(p.low for p in sigma), max(p.high for p in sigma))
        return self._replace(white=white or None)

    @property
    def beyond(self):
        """Are limits wrong, as the record goes beyond them?"""
        return bool(self.instead) and "limits" in self.found.values

    @property
    def wrong(self):
        """Symbol of the value that is wrong, of a reading that is another `instead`."""
        symbol, own = WRONG[self.found.name], self.instead.found.values
        other = OTHER.get(self.found.name)
        same = other and np.isclose(own[symbol], self.found.values[symbol], rtol=ALIKE)
        return other if same else symbol

    @property
    def does_something(self):
        """Does it alter any value?"""
        values = self.found.values
        return values.get("lsb", 1.0) > 0.0 and bool(
            np.isfinite(values.get("limits", 0.0)).any())


class Smoothing(NamedTuple):
    """What a moving average or a steep low-pass does."""

    undo: object    # function of records (R, N) to those before it, as `undone` and
                    # `filled` have it
    leaves: float   # of the standard deviation of white noise


COINCIDENCE = 23.0    # nats: what one repeated value in double precision is worth,
                      # about ln(1e10 distinguishable values in the noise)
HIDDEN = 0.25         # of the samples: if more are clipped, what they may have been
                      # says too little
HIDING = 4.0          # of the white noise: of a coarser lattice few codes are met,
                      # and these for long, unless ...
SOON = 16             # ... samples later many have been passed: what is slow is smooth
SMOOTH = 1.5          # of the white noise: what a finer lattice adds is white noise to
                      # exp(-2 pi^2 / 1.5^2) = 2e-4 of it (the same)


NEARLY_ALL = 0.9      # of the samples: if fewer were given, lines between them make a
                      # low-pass
ROUNDING = 1e-9       # of the white noise: equal but for rounding


def readings(scene, average=None):
    """Quantization, uneven codes, saturation, dropouts, repeated and stuck samples of a
    record from which nothing was taken away, or a moving average, or a steep low-pass
    and what is stuck behind it, as a tuple of Reading. The `average` of its simulator,
    `Found`, is there, too, if it is so short that no record shows it.
    """
    y, N, seen = scene.y, len(scene.y), []
    lost = dropouts(y)
    if lost.own.any():
        spans = [[float(begin * scene.dt), int(n)] for begin, n in zip(*runs(lost.own))]
        seen.append(_shown_by(lost.own, "dropouts", value=lost.value, spans=spans))
        y = np.where(lost.own, np.nan, y)
    pulses = counts_of_integral(y)
    if pulses.lsb:    # others that are equal are so as there is no pulse
        return (*seen, _counted(y, pulses))
    between = interpolated(y)
    shown = averaged_over(y) if not between.every else Average()
    average = _unless_shown(shown, scene, y, average)
    repeats = repeated(y, between.own) if not average.taps else None
    slower = between.rate < NEARLY_ALL or repeats and repeats.polled
    steep = Steep() if slower else steep_low_pass(
        np.where(between.own, np.nan, y),
        average.taps and (average.taps, average.times))
    if steep.poles:    # of what was read before it, no value but counts shows anything
        return (*seen, *_low_passed(scene, y, steep))
    if average.taps:
        return (*seen, *_averaged(scene, y, average))
    for name, rest, more in (("repeated_samples", repeats, {}), (
            "interpolated_samples", between, dict(order=between.order))):
        if rest.own.any():
            phase = None if rest.phase is None else float(2.0 * np.pi * rest.phase)
            seen.append(_shown_by(rest.own, name, frequency=rest.rate / scene.dt,
                                  phase=phase, **more))
    y = np.where(repeats.own | between.own, np.nan, y)
    lsb, noise = lattice_and_noise(y)
    moved = lattice_between(y) if not lsb else 0.0
    if moved:
        lsb, noise = moved, less_rounding(noise, moved)
    limits, clipped = limits_of(y, lsb, noise)
    spans, stuck = stuck_spans(y, lsb, clipped)
    if clipped.any():
        seen.append(_shown_by(clipped, "saturation", limits=limits)._replace(
            opaque=bool(clipped.mean() > HIDDEN)))
    seen += _stuck(scene, spans, stuck)
    counts = _rounded(y, lsb, noise, bool(moved))
    seen += counts
    if counts:
        codes, log_bayes = uneven_codes(y[~(clipped | stuck)], lsb)
        if codes and not moved:
            seen.append(Reading(_found("differential_nonlinearity", codes=codes),
                                log_bayes, np.zeros(N, bool), False))
    return tuple(seen)


def _unless_shown(shown, scene, y, average):
    """The `Average` that a record (N,) shows, or else that which its simulator has."""
    if shown.taps or not average:
        return shown
    taps, times = taps_and_times(scene, **average.values)
    return as_averaged(y, taps, times, average.variant == ROUNDED) if (
        1 < taps < FEWEST_TAPS) else shown


def _counted(y, pulses):
    """The `Reading` of counts of the integral."""
    return Reading(_found(INTEGRAL, lsb=pulses.lsb), COINCIDENCE * len(y), np.zeros(
        len(y), bool), False, pulses.coarse)


def _averaged(scene, y, average):
    """The `Reading` of an average, and of the counts before it or behind it."""
    taps, times, lsb = average.taps, average.times, lattice(y)
    found = _found("moving_average", window=taps * scene.dt, times=times)
    shown = Reading(found, average.log_bayes, np.zeros(len(y), bool), False,
                    counts=average.counts)
    if not average.counts:
        raw, lsb = undone(y, taps, times), taps**times * lsb
        return (shown, *_rounded(raw, lsb, noise_of(raw, lsb)))
    counts = _rounded(y, lsb, noise_of(y, lsb, times * taps))
    if counts:
        shown = shown._replace(found=found._replace(variant=ROUNDED))
    return (shown, *counts)


def _low_passed(scene, y, steep):
    """The `Reading` of a steep low-pass, and of the counts behind it."""
    lsb = lattice(y)
    counts = _rounded(y, lsb, noise_of(y, lsb, round(0.5 / steep.cutoff)))
    found = _found("steep_low_pass", cutoff=steep.cutoff / scene.dt, poles=steep.poles)
    nothing = np.zeros(len(y), bool)
    if counts:
        found = found._replace(variant=ROUNDED)
    shown = Reading(found, steep.log_bayes, nothing, False), *counts
    spans, stuck = ([], nothing) if counts else stuck_spans(y, lsb, nothing)
    return (*shown, *_stuck(scene, spans, stuck))


def _stuck(scene, spans, stuck):
    """The `Reading` of samples (N,) that are stuck, in spans, in a list, if any are."""
    spans = [[float(begin * scene.dt), int(n)] for begin, n in spans]
    return [_shown_by(stuck, "stuck", spans=spans)] if spans else []


def _shown_by(masked, name, **values):
    """A `Reading` that samples (N,) show, which say nothing else."""
    return Reading(_found(name, **values), COINCIDENCE * float(masked.sum()), masked,
                   False)


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
    noise = noise_of(y, lsb) if noise is None else noise
    return bool(lsb > HIDING * noise and lsb > NOISY * noise_of(y, lsb, SOON))


def compared(scene, own, simulated=None):
    """Readings (of Reading) that the simulator has and those that the record shows,
    from those that are said to be its `own` (of Found). What both have is worth 0 nats.

    Where records of the simulator, `simulated` (L, N), are all that is known of it,
    both were rounded by the same sensor: a record that lies on no lattice was added to
    since, and counts may be too fine to show in theirs.
    """
    average = next((one for one in own if one.name == "moving_average"), None)
    seen, had = {r.found.name: r for r in readings(scene, average)}, {}
    measured, rounded = simulated is not None, seen.get("quantization")
    if measured and rounded and all(one.name != "quantization" for one in own) and (
            np.isclose(lattice(np.atleast_2d(simulated)[0]),
                       rounded.found.values["lsb"], rtol=ALIKE)):
        own = (*own, rounded.found)
    for one in own:
        name, shown = one.name, seen.get(one.name)
        mine = Reading(one, 0.0, np.zeros(len(scene.y), bool), False)
        if name == "quantization" and INTEGRAL in seen:    # which are rounded, too
            had[name] = mine
        elif shown and _alike(scene, one.values, shown.found.values):
            had[name] = seen[name] = shown._replace(log_bayes=0.0)
        elif not shown and measured and name == "quantization" and adds_noise(
                scene.y, one.values["lsb"]):
            had[name] = seen[name] = mine._replace(moved=True)
        elif name in NONE and (shown or _would_show(scene, one, own)):
            new = (shown or mine._replace(
                found=one._replace(values=NONE[name](scene, own)),
                log_bayes=COINCIDENCE * len(scene.y)))._replace(instead=mine)
            had[name], seen[name] = mine, new._replace(
                factor=new.found.values[new.wrong] / one.values[new.wrong])
        elif not shown and name == "saturation" and (wider := _beyond(scene, one)):
            seen[name] = wider._replace(instead=mine)
        elif not shown and name == CODES and (even := _even(scene, one, rounded)):
            had[name], seen[name] = mine, even._replace(instead=mine, factor=0.0)
        elif not shown and name not in AT_TIMES:
            had[name] = seen[name] = mine
    counts = seen.get("quantization")
    if counts and counts.instead and seen.get(CODES) is had.get(CODES):
        seen.pop(CODES, None)    # they are those of other counts
    return tuple(had.values()), tuple(seen.values())


SMOOTHING = "moving_average", "steep_low_pass"
CODES, INTEGRAL = "differential_nonlinearity", "integral_quantization"
AT_TIMES = "stuck", "dropouts"    # what the next record need not show
ALIKE = 0.02    # relative: two counts or limits that are the same
WRONG = dict(quantization="lsb", repeated_samples="frequency",
             interpolated_samples="frequency", saturation="limits",
             moving_average="window", differential_nonlinearity="codes",
             steep_low_pass="cutoff", integral_quantization="lsb")
OTHER = dict(moving_average="times", steep_low_pass="poles")
NONE = dict(    # the values of a reading that does nothing
    quantization=lambda scene, own: dict(lsb=_spacing_where_rounded(scene, own)),
    repeated_samples=lambda scene, own: dict(frequency=1.0 / scene.dt, phase=np.pi),
    interpolated_samples=lambda scene, own: dict(
        frequency=1.0 / scene.dt, phase=np.pi, order=1),
    moving_average=lambda scene, own: dict(window=scene.dt, times=1),
    steep_low_pass=lambda scene, own: dict(cutoff=0.5 / scene.dt, poles=1),
    integral_quantization=lambda scene, own: dict(lsb=0.0))


def _alike(scene, own, seen):
    """Is a reading of the simulator that of the record of a scene? Where samples stick,
    repeat or are lost may differ, what stands for lost ones, and which codes are met; a
    rate at random is counted.
    """
    if "cutoff" in own:
        y = np.where(dropouts(scene.y).own, np.nan, scene.y)
        return log_odds_of_another(y, own["cutoff"] * scene.dt, own["poles"]
                                   ) < CERTAIN
    samples = len(scene.y)
    at_random = seen.get("phase", 0.0) is None
    rtol = ALIKE + (2.0 / np.sqrt(samples) if at_random else 0.0)
    return all(symbol in ("spans", "phase", "codes", "order", "value")
               or np.allclose(value, seen[symbol], rtol=rtol)
               for symbol, value in own.items())


def _would_show(scene, one, own):
    """Would a record like that of a scene show a reading of a simulator, of its own?"""
    if one.name == "quantization":
        return one.values["lsb"] > COARSE * _noise_where_rounded(scene, own)
    if one.name == INTEGRAL:
        return is_no_integral(scene.y, one.values["lsb"])
    if one.name == "moving_average":
        return FEWEST_TAPS * scene.dt <= one.values["window"] <= (
            scene.duration / FEWEST_TURNS)
    if one.name == "steep_low_pass":
        return one.values["cutoff"] * scene.dt < HIGHEST and (
            len(scene.y) >= FEWEST_SAMPLES)
    return len(scene.y) * (1.0 - one.values["frequency"] * scene.dt) > 2.0 * FEWEST


def _spacing_where_rounded(scene, own):
    """Spacing of the lattice that the record of a scene was on where a simulator with
    readings of its own rounds it.
    """
    lsb, smooth = lattice(scene.y), _smoothing(own)
    if not smooth or smooth.variant == ROUNDED or "window" not in smooth.values:
        return lsb
    taps, times = taps_and_times(scene, **smooth.values)
    return taps**times * lsb


def _smoothing(own):
    """What smooths of readings of a simulator, or None."""
    return next((one for one in own if one.name in SMOOTHING), None)


def _noise_where_rounded(scene, own):
    """Standard deviation of the white noise of the record of a scene where a simulator
    with readings of its own rounds it: before it is smoothed, or behind that.
    """
    smooth = _smoothing(own)
    if not smooth:
        return lattice_and_noise(scene.y)[1]
    if "window" not in smooth.values:
        return noise_of(scene.y, 0.0) if smooth.variant == ROUNDED else np.inf
    taps, times = taps_and_times(scene, **smooth.values)
    if smooth.variant == ROUNDED:
        return noise_of(scene.y, lattice(scene.y), taps * times)
    return noise_of(undone(scene.y, taps, times), 0.0)


def _even(scene, one, rounded):
    """The `Reading` of codes that are all as wide, of the simulator's counts, if the
    record of a scene has such; or None.
    """
    (first, _), (second, _), *_ = codes = one.values["codes"]
    lsb = second - first
    if not rounded or not np.isclose(lsb, rounded.found.values["lsb"], rtol=ALIKE):
        return None
    even, log_bayes = [[value, lsb] for value, _ in codes], -odds_to_even(
        scene.y, lsb, codes)
    return Reading(one._replace(values=dict(codes=even)), log_bayes, np.zeros(
        len(scene.y), bool), False) if log_bayes > CERTAIN else None


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
        values = dict(parameter=f"{r.found.name}.{r.wrong}",
                      factor=r.factor)
    return one._replace(values={
        symbol: (value, 0.0) for symbol, value in values.items()})


def _found(name, **values):
    return Found(CATALOGUE[name], values=values)


def recorded(y, dt, columns):
    """`Scene` of a record (N,) and its columns as they were recorded."""
    given, y = y, less_resampling(y)
    lost = dropouts(y).own
    sensed = np.where(lost, np.nan, y)
    lsb, noise = lattice_and_noise(sensed)
    largest = _spacing_of_largest(sensed)
    if lsb < largest <= COARSE * noise:    # what is small was rounded by less: a noise
        lsb, sensed = largest, largest * np.round(sensed / largest)    # that changes
    if y is given:    # what lies between knots is on no lattice
        sensed = on_samples(snapped(sensed, interpolated(sensed).own))
    return Scene(np.where(lost, y, sensed), dt, columns,
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


def adds_noise(y, lsb):
    """Is rounding to multiples of lsb about a further white noise for a record that
    lies on no lattice, or does it hide more?
    """
    _, noise = lattice_and_noise(y)
    return bool(lsb <= NOISY * less_rounding(noise, lsb))


def misleads(reading, noise):
    """Does a reading more than leave out samples and add a white noise to one that is
    there? Then the fit is off.
    """
    values = reading.found.values
    return "limits" in values or values.get("lsb", 0.0) > SMOOTH * noise


def latent_mean(y, seen):
    """Mean of a record before it was clipped, or rounded to a coarse lattice, if any of
    the `Reading` does that, else None: the most likely one if its values are normal
    (J. Tobin, Econometrica 26, 1958).
    """
    limits = [r.found.values["limits"] for r in seen if "limits" in r.found.values]
    coarse = [r.cell for r in seen if r.coarse and r.cell]
    if not limits and not coarse:
        return None
    return latent_law(y, (limits or [(-np.inf, np.inf)])[0], (coarse or [0.0])[0])[0]


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
            lsb = max(one.cell for one in seen)
            y[clipped] = (unclipped(raw, low, high, lsb) - full.known)[clipped]
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
    for smoothing in filter(None, (one.smoothing(scene) for one in seen)):
        y = smoothing.undo(y)
    return y
