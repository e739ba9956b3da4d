"""The catalogue: every effect that is looked for, with its equation.

An effect of your own is another `Effect`; those below are examples of every kind.
"""

import copyreg

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfilt

import sensorlab.gap.processes as processes
import sensorlab.gap.shapes as shapes
from sensorid import Parameter
from sensorlab.gap.effects import Effect
from sensorlab.gap.interpolated import interpolated
from sensorlab.gap.repeats import repeated_at_random
from sensorlab.gap.steep import NO_CUTOFF
from sensorlab.gap.values import lattice


# ---- readings: (scene, y, **values) alters the values y (..., N) in place

def quantize(scene, y, lsb):
    """Round to multiples of lsb, on the lattice of the scene's record if it has one; 0
    is not rounded.
    """
    if lsb:
        origin = _origin(scene)
        y[:] = origin + lsb * np.round((y - origin) / lsb)


def _origin(scene):
    """A value on the lattice of a scene's record, 0 if it is on none."""
    raw = scene.y + scene.known
    seen = raw[~np.isnan(raw)]
    return seen[0] if len(seen) and lattice(raw) else 0.0


def _count(scene, y, lsb):
    """Every sample becomes an increment of the integral, which is rounded."""
    if lsb:
        origin = _origin(scene)    # of any, as many counts more are in every sample
        angle = np.cumsum((y - origin) / lsb, axis=-1)
        y[:] = origin + lsb * np.diff(np.round(angle), axis=-1, prepend=0.0)


def convert(scene, y, codes):
    """What lies within the codes of a converter, (value, width) each, becomes the value
    of its code; they are half a spacing about their values, were they all as wide.
    """
    value, width = np.transpose(codes)
    ends = value[0] - 0.5 * (value[1] - value[0]) + np.cumsum([0.0, *width])
    inside = (y >= ends[0]) & (y < ends[-1])
    y[inside] = value[np.searchsorted(ends, y[inside], "right") - 1]


def _saturate(scene, y, limits):
    np.clip(y, *limits, out=y)


def _parts(y, scene, spans):
    """Views of records at spans of (start in s, samples)."""
    for start, length in spans:
        first = round(start / scene.dt)
        yield y[..., first:first + int(length)]


def _stick(scene, y, spans):
    for part in _parts(y, scene, spans):
        part[:] = part[..., :1]


def _drop(scene, y, value, spans):
    for part in _parts(y, scene, spans):
        part[:] = value


def _average(scene, y, window, times=1):
    """Every sample becomes the mean of all in a window that ends with it; before the
    record, of its first. If it does so twice, that is a triangular window.
    """
    taps, times = taps_and_times(scene, window, times)
    for _ in range(times):
        y[:] = uniform_filter1d(y, taps, mode="nearest", origin=(taps - 1) // 2)


ROUNDED = "before the rounding"    # what comes out is rounded, not what goes in


def taps_and_times(scene, window, times=1):
    """Samples in a window, at least one, and how often a mean of so many is taken."""
    return max(round(window / scene.dt), 1), times


def _pass(scene, y, cutoff, poles):
    """Every record passes a Butterworth filter, which its first sample is at rest in.
    """
    if cutoff * scene.dt < NO_CUTOFF:
        first = y[..., :1].copy()
        sections = butter(poles, 2.0 * cutoff * scene.dt, output="sos")
        y[:] = first + sosfilt(sections, y - first)


def repeat(scene, y, frequency, phase):
    """Every sample becomes the last that a sensor of a rate of its own has given. With
    no phase it gives them at random: where the scene's record has them if it has.
    """
    for one, given in _given(scene, y, frequency, phase, repeated_at_random):
        one[:] = one[given[np.searchsorted(given, np.arange(len(one)), "right") - 1]]


def interpolate(scene, y, frequency, phase, order):
    """The same, but samples between lie on straight lines, or on smooth curves."""
    number = np.arange(y.shape[-1])
    for one, given in _given(scene, y, frequency, phase, lambda y: interpolated(y).own):
        curve = order > 1 and len(given) > order and CubicSpline(given, one[given])
        line = np.interp(number, given, one[given])
        one[:] = np.where(number <= given[-1], curve(number), line) if curve else line


def _given(scene, y, frequency, phase, others):
    """Records of y (..., N), and the numbers of the samples that a sensor of a rate of
    its own has given; at random where the `others` of the scene's record are not.
    """
    if phase is not None:
        number = np.floor(frequency * scene.time + phase / (2.0 * np.pi))
        own = np.diff(number, prepend=-1.0) > 0.0
    else:
        left_out = others(scene.y + scene.known)
    for one in y.reshape(-1, y.shape[-1]):    # a view
        if phase is None:
            # a seed of its own numbers: whatever records are made with it, it is the
            # same
            rng = np.random.default_rng(one[:OWN_SEED].copy().view(np.uint64))
            own = ~left_out if left_out.any() else (
                rng.random(len(one)) <= frequency * scene.dt)
            own[0] = True
        yield one, np.flatnonzero(own)


OWN_SEED = 16       # samples


# ---- the catalogue

MIN_CYCLES = 3    # in a record, of a sinusoid: slow noise shows fewer by itself
                  # (S. Krishnan et al., Mon. Not. R. Astron. Soc. 508, 2021)


def _log(symbol, low, high):
    return Parameter(symbol, low, max(high, 1.01 * low), True)


def _spread(scene):
    return max(np.nanstd(scene.y), 3.0 * scene.white)


def _ratio(most):
    """Prior of how many times as strong a noise is elsewhere."""
    return _log("ratio", 1.0 / most, most)


def _most_varied(scene):
    """How many times as strong a noise may be that white noise hides in part, or that
    varies within the parts of a record that show how it varies.
    """
    return max(30.0, 5.0 * scene.contrast**2)


MIN_PULSE = 3     # samples: fewer are outliers
MIN_SHAPED = 8    # of a pulse: fewer have no shape but a rectangle
MIN_RINGING = 16    # of a ringing, or a burst: fewer are outliers
MIN_STEPS = 10    # in a record, on average: fewer are bias steps
MIN_REST = 30    # samples from one step to the next: fewer are a walk
WIDEST_PLAY = 0.4    # of the range of a column, to either side: a wider loop is hardly
                     # told from the column itself
LATEST = 300.0    # sampling intervals by which a sensor is late
MIN_BURST = 8    # samples of a burst of noise: fewer are outliers
MIN_SIDE = 16    # samples on either side of a change of noise: fewer tell no variance


CHANGES = "after the onset", processes.BEFORE
RAMPS = "as simulated in the middle", processes.AT_FIRST, processes.AT_LAST
PLACES = "", processes.BEFORE_LOW_PASS
VALUES = "value", processes.LEAST, processes.MOST


def _onset(scene, samples=1):
    """Prior of an onset with so many samples on either side at least."""
    return Parameter("onset", samples * scene.dt, scene.duration - samples * scene.dt)


CATALOGUE = {effect.name: effect for effect in (
    Effect("rate_ramp", columns=shapes.from_start, size="slope",
           equation="y + slope t; slope in u/s",
           resembles="random walk, slow transient",
           experiment="record longer"),
    Effect("bias_step", columns=shapes.from_onset, search="onset",
           parameters=lambda s: (_onset(s, MIN_PULSE),),
           equation="y + size from t = onset on; onset in s, size in u",
           resembles="random walk, one stuck interval",
           experiment="look for what happened at the onset: a knock, a restart"),
    Effect("pulse", columns=shapes.between, search="pulse",
           becomes="bias_step",    # as nearly, of long duration
           parameters=lambda s: (_onset(s), _log("duration", MIN_PULSE * s.dt,
                                                 0.5 * s.duration)),
           equation="y + size f, from t = onset on; f = 1 or sin(pi s), 0 <= s < 1, or "
                    "exp(-3 s), s = (t - onset) / duration; both in s, size in u",
           resembles="random telegraph, two bias steps, outliers",
           experiment="look for what happened then: a shock, another load"),
    Effect("gradual_step", columns=shapes.settling, search="pulse", becomes="bias_step",
           parameters=lambda s: (_onset(s), _log("duration", shapes.MIN_SLOW * s.dt,
                                                 0.5 * s.duration)),
           equation="y + size (1 - exp(-3 s)), s = (t - onset) / duration > 0; both in "
                    "s, size in u",
           resembles="bias step, turn-on transient, random walk",
           experiment="look for what changed at the onset: a load, a heater"),
    Effect("ringing", columns=shapes.ringing, search="waves", size="amplitude",
           parameters=lambda s: (
               _onset(s), _log("duration", MIN_RINGING * s.dt, s.duration / 2.0),
               Parameter("frequency", MIN_CYCLES / s.duration, 0.5 / s.dt)),
           equation="y + amplitude exp(-3 s) cos(2 pi frequency (t - onset) + phase), "
                    "s = (t - onset) / duration > 0; onset and duration in s, "
                    "frequency in Hz, amplitude in u",
           resembles="narrow-band noise, pulse, outliers",
           experiment="knock at the mount: it rings at the same frequency"),
    Effect("vibration_burst", columns=shapes.burst, search="waves", size="amplitude",
           parameters=lambda s: (
               _onset(s), _log("duration", MIN_RINGING * s.dt, s.duration / 2.0),
               Parameter("frequency", MIN_CYCLES / s.duration, 0.5 / s.dt)),
           equation="y + amplitude sin(pi s)^2 cos(2 pi frequency (t - onset) + "
                    "phase), s = (t - onset) / duration from 0 to 1; onset and "
                    "duration in s, frequency in Hz, amplitude in u",
           resembles="ringing, narrow-band noise, sinusoid",
           experiment="look for what ran then: a motor, a passing vehicle"),
    Effect("second_order_drift", columns=shapes.parabola, size="curvature",
           becomes="rate_ramp",    # as nearly, with its vertex far away
           parameters=lambda s: (Parameter("vertex", 0.0, s.duration),),
           equation="y + curvature (t - vertex)^2; vertex in s, curvature in u/s^2",
           resembles="turn-on transient, rate ramp, random walk",
           experiment="record longer"),
    Effect("turn_on_transient", columns=shapes.transient,
           parameters=lambda s: (_log("tau", shapes.least_seen(s), s.duration / 3),),
           equation="y + size exp(-t / tau); tau in s, size in u",
           resembles="rate ramp, temperature",
           experiment="switch off, cool down and on again: it returns"),
    Effect("sinusoid", columns=shapes.cosine_and_sine, search="frequency",
           size="amplitude",
           parameters=lambda s: (Parameter("frequency", MIN_CYCLES / s.duration,
                                           0.5 / s.dt),),
           equation="y + amplitude cos(2 pi frequency t + phase); frequency in Hz, "
                    "amplitude in u",
           resembles="correlated noise of long period",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("temperature", columns=shapes.of_temperature, size="coefficient",
           column="temperature",
           equation="y + coefficient (x - mean of x), x less a white noise of its own; "
                    "in u per unit of x",
           resembles="random walk, thermal lag",
           experiment="cycle the temperature twice at different speed"),
    Effect("thermal_lag", columns=shapes.lagged_values, size="coefficient",
           column="temperature", becomes="temperature",
           parameters=lambda s: (_log("tau", shapes.least_tau(s), s.duration / 4),),
           equation="y + coefficient f, f = X less its mean, or X - x where what comes "
                    "at once is compensated, tau dX/dt = x - X; tau in s, coefficient "
                    "in u per unit of x",
           resembles="temperature",
           experiment="step the temperature and hold it"),
    Effect("scale_factor", columns=shapes.linear, size="coefficient", column="rate",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="nonlinearity",
           experiment="turn at several known rates of both signs"),
    Effect("thermal_scale_factor", columns=shapes.while_warm, size="coefficient",
           column=("rate", "acceleration"), also="temperature",
           equation="y + coefficient (T - mean of T) (x - mean of x), T the column "
                    "temperature; in u per unit of x and kelvin",
           resembles="scale factor, nonlinearity",
           experiment="turn at a known rate while the temperature is cycled"),
    Effect("misalignment", columns=shapes.linear, size="coefficient",
           column=tuple(f"rate_{axis}" for axis in shapes.AXES),
           equation="y + coefficient (x - mean of x), x the rate about another axis; "
                    "in u per unit of x",
           resembles="scale factor, if the axes are turned together",
           experiment="turn about one axis after the other"),
    Effect("nonlinearity", columns=shapes.curved, size="coefficient",
           column=("rate", "acceleration"),
           equation="y + coefficient f, f = x^2 or |x| less its mean; in u per unit "
                    "of f",
           resembles="scale factor where the rate has one sign",
           experiment="turn at several known rates of both signs"),
    Effect("latency", columns=shapes.derivative, size="coefficient",
           column=("rate", "acceleration"),
           equation="y + coefficient dx/dt; in u per unit of x and second",
           resembles="scale factor under slow motion, lag",
           experiment="turn with sharp starts and stops"),
    Effect("lag", columns=shapes.lagging, size="coefficient",
           column=("rate", "acceleration", "*"),
           becomes=("latency", "scale_factor", "g_sensitivity", "covariate"),
           parameters=lambda s: (_log("tau", s.dt, s.dt * np.clip(
               len(s.y) / 40.0, 2.0, LATEST)),),
           equation="y + coefficient (X - x), X = x(t - tau), or x(t + tau) where the "
                    "column is late, or x after a low-pass of first or second order "
                    "that delays by tau; tau in s, coefficient in u per unit of x, 1 "
                    "of a sensor that is but late",
           resembles="latency where tau is short, noise of the column where the "
                    "coefficient is 1, hysteresis, scale factor",
           experiment="turn with sharp starts and stops"),
    Effect("g_sensitivity", columns=shapes.linear, size="coefficient",
           column=("acceleration", *(f"acceleration_{axis}" for axis in shapes.AXES)),
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="scale factor",
           experiment="turn the sensor over at rest"),
    Effect("covariate", columns=shapes.linear, size="coefficient", column="*",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="any drift that moves as the column does",
           experiment="vary that quantity alone"),
    Effect("hysteresis", columns=shapes.hysteresis, column="any",
           parameters=lambda s: (_log("play", 3e-4, WIDEST_PLAY),),
           equation="y + size (x - X) / width, X follows x as soon as it is width = "
                    "play (max x - min x) behind; play without unit, size in u",
           resembles="thermal lag, lag, scale factor, random telegraph",
           experiment="drive that quantity up and down at different speed"),
    Effect("random_walk", model=processes.random_walk, elementwise=True,
           parameters=lambda s: (_log("sigma_w", s.white / len(s.y),
                                      _spread(s) / np.sqrt(len(s.y)) * 10.0),),
           equation="y + w, w the sum of white noises of standard deviation sigma_w, "
                    "in u per sample",
           resembles="rate ramp, correlated noise of long time, bias instability",
           experiment="record longer"),
    Effect("correlated_noise", model=processes.correlated_noise, elementwise=True,
           parameters=lambda s: (_log("tau", 1.5 * s.dt, s.duration / 10),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + m, dm/dt = -m / tau + white noise, standard deviation of m "
                    "sigma; tau in s, sigma in u",
           resembles="bias instability, random telegraph, random walk",
           experiment="record longer, sample faster"),
    Effect("bias_instability", model=processes.bias_instability, elementwise=True,
           parameters=lambda s: (_log("sigma", 0.01 * s.white, _spread(s)),),
           equation="y + Markov processes of the spectrum B^2 / (2 pi f) together, B = "
                    "sigma sqrt(pi / (decades ln 10)) in u, decades one more than "
                    "whole ones from dt to T / 10",
           resembles="correlated noise, random walk", experiment="record longer"),
    Effect("narrow_band_noise", model=processes.narrow_band, elementwise=True,
           search="band",
           parameters=lambda s: (Parameter("frequency", MIN_CYCLES / s.duration,
                                           0.5 / s.dt),
                                 _log("tau", 2.0 * s.dt, s.duration / 10),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + a process of covariance sigma^2 exp(-|t| / tau) "
                    "cos(2 pi frequency t), 0 where 2 pi frequency tau < 2; frequency "
                    "in Hz, tau in s, sigma in u",
           resembles="sinusoid where tau is long, correlated noise where it is short",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("bandwidth", model=processes.bandwidth, elementwise=True, search="spectrum",
           variants=("first order", "second order", "digital", "digital first order",
                     "digital white noise", "digital first order white noise",
                     processes.EXPONENTIAL),
           alike=("first order", processes.EXPONENTIAL),
           of_all=(("digital", "digital white noise"),
                   ("digital first order", "digital first order white noise"),
                   (processes.EXPONENTIAL, "first order")),
           parameters=lambda s: (_log("tau", 0.15 * s.dt, 50.0 * s.dt),),
           equation="the white noise v becomes V, tau dV/dt = v - V, or tau^2 d2V/dt2 "
                    "+ sqrt(2) tau dV/dt = v - V, sampled, with the density that v has "
                    "at rest; a digital one (of second order, or "
                    "first), the bilinear transform of either that keeps the cut-off "
                    "1 / (2 pi tau), or an exponential one, y + a (Y - y) with a = "
                    "exp(-dt / tau) and Y the value before, has random walks, Markov "
                    "processes, narrow-band noise, levels, what begins at some time "
                    "and what follows a column pass it, too, or, as always beside "
                    "walk_step, the white noise alone; tau in s",
           resembles="correlated noise of short time", experiment="sample faster"),
    Effect("blue_noise", model=processes.blue_noise, elementwise=True,
           search="spectrum",
           parameters=lambda s: (_log("tau", 0.25 * s.dt, 50.0 * s.dt),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + w - W, tau dW/dt = w - W, w white noise, standard deviation "
                    "of w - W sigma; tau in s, sigma in u",
           resembles="quantization of the angle, white noise that is low-passed",
           experiment="integrate: the angle has white noise"),
    Effect("noise_step", model=processes.noise_step, drive=processes.stronger_from,
           of_white=True, elementwise=True, search="onset", variants=CHANGES,
           alike=CHANGES,
           parameters=lambda s: (_onset(s, MIN_SIDE), _ratio(max(
               10.0, 3.0 * s.contrast))),
           equation="the white noise becomes ratio times as strong from t = onset "
                    "on, or is so before; onset in s",
           resembles="outliers in clusters, noise ramp",
           experiment="look for what was switched on at the onset"),
    Effect("noise_ramp", model=processes.noise_along, drive=processes.stronger_along,
           of_white=True, elementwise=True, variants=RAMPS, alike=RAMPS,
           relative_to=processes.whole_range,
           parameters=lambda s: (_ratio(_most_varied(s)),),
           equation="the white noise becomes ratio^((t - about) / per) times as "
                    "strong, about in the middle or at an end; about and per in s",
           resembles="noise step, noise sensitivity where the column drifts",
           experiment="record longer, and the temperature with it"),
    Effect("noise_sensitivity", model=processes.noise_along,
           drive=processes.stronger_along,
           of_white=True, elementwise=True, column="any", variants=(*VALUES, "square"),
           alike=VALUES, relative_to=processes.whole_range,
           parameters=lambda s: (_ratio(_most_varied(s)),),
           equation="the white noise becomes ratio^u times as strong, or sqrt(1 + "
                    "(ratio^2 - 1) u^2) times, u = (x - about) / per; about and per "
                    "in units of x",
           resembles="bursts of noise, change of the noise, outliers",
           experiment="hold that quantity at several values, compare the Allan "
                      "deviations"),
    Effect("walk_step", model=processes.walk_step, drive=processes.stronger_from,
           elementwise=True, search="onset",
           parameters=lambda s: (_onset(s, MIN_SIDE), _ratio(_most_varied(s))),
           equation="the noise that drives the random walk, or the Markov process, "
                    "becomes ratio times as strong from t = onset on; onset in s",
           resembles="random telegraph, bias step, correlated noise",
           experiment="look for what was switched on at the onset; record longer"),
    Effect("outliers", jumps=processes.outliers, model=processes.shot, elementwise=True,
           variants=PLACES, alike=PLACES, before=PLACES[1:],
           parameters=lambda s: (_log("rate", 1.0 / len(s.y), 0.1),
                                 _log("sigma", 2.0 * s.white,
                                      max(300.0 * s.white, 3.0 * s.leap))),
           equation="y + N(0, sigma^2) with the probability rate in every sample, or "
                    "the same before a digital low-pass that all passes; sigma in u",
           resembles="noise step, random telegraph",
           experiment="log the raw bus: are they transmission errors? Those before a "
                      "low-pass are not: look for knocks"),
    Effect("noise_bursts", jumps=processes.noise_bursts,
           variants=PLACES, alike=PLACES, before=PLACES[1:],
           parameters=lambda s: (
               _log("quiet", MIN_BURST * s.dt, s.duration / 4.0),
               _log("duration", MIN_BURST * s.dt, s.duration / 10.0),
               _log("sigma", 0.5 * s.white, max(30.0 * s.white, 3.0 * s.leap))),
           equation="y + N(0, sigma^2) in every sample of a burst, or the same before "
                    "a digital low-pass; bursts last for duration and are quiet apart "
                    "on average, in s; sigma in u",
           resembles="outliers in clusters, noise step, noise sensitivity",
           experiment="look for what runs at times: a fan, a motor, a radio"),
    Effect("random_telegraph", jumps=processes.telegraph,
           parameters=lambda s: (_log("dwell", 3.0 * s.dt, s.duration / 4),
                                 _log("size", 0.1 * s.white,
                                      max(2.0 * _spread(s), s.leap))),
           equation="y +- size / 2, two levels, each kept for dwell on average; "
                    "dwell in s, size in u",
           resembles="correlated noise",
           experiment="average less white noise away: two levels show in a histogram"),
    Effect("random_steps", jumps=processes.random_steps, model=processes.level,
           elementwise=True, becomes="random_walk",    # as nearly, of many small steps
           parameters=lambda s: (
               _log("dwell", MIN_REST * s.dt, s.duration / MIN_STEPS),
               _log("sigma", 0.3 * s.white, 3.0 * _spread(s))),
           equation="y + L, L moves by N(0, sigma^2) at times that are dwell apart on "
                    "average; dwell in s, sigma in u",
           resembles="random walk, bias step, random telegraph",
           experiment="average less white noise away: the level stands still between"),
    Effect("quantization", reading=quantize, model=processes.rounding, elementwise=True,
           equation="lsb round(y / lsb); lsb in u",
           resembles="white noise",
           experiment="widen the word length, raise the gain"),
    Effect("integral_quantization", reading=_count,
           model=processes.rounding_of_integral, elementwise=True,
           equation="lsb (round(A / lsb) - round(B / lsb)), A the sum of y up to the "
                    "sample, B that before it: pulses of an integrating sensor, "
                    "increments of an angle or a velocity; lsb in u, that of the "
                    "integral over the sampling interval; its Q (IEEE Std 952) is "
                    "lsb dt / sqrt(12)",
           resembles="blue noise, quantization",
           experiment="add up the record: the integral is what is rounded"),
    Effect("differential_nonlinearity", reading=convert,
           equation="the value of the code of a converter within whose width y lies, "
                    "with codes of (value, width), in u; all widths are lsb without it",
           resembles="coarser quantization",
           experiment="sweep the input slowly over the codes and count how often each "
                      "is met (IEEE Std 1241)"),
    Effect("saturation", reading=_saturate,
           equation="y between two limits, in u",
           resembles="skewed noise",
           experiment="widen the range"),
    Effect("stuck", reading=_stick,
           equation="y keeps its value in spans of (start in s, samples)",
           resembles="quantization",
           experiment="compare the counters of sensor and logger"),
    Effect("dropouts", reading=_drop, comes_last=True,
           equation="y is value, in u, in spans of (start in s, samples)",
           resembles="outliers, stuck samples, random telegraph noise",
           experiment="look for what the logger writes in the place of a lost sample; "
                      "leave lost samples empty in the file"),
    Effect("repeated_samples", reading=repeat,
           equation="y is what the sensor gave last, which samples at frequency, in "
                    "Hz, below that of the record; phase, in rad, at the first; none "
                    "if it samples at random",
           resembles="stuck samples, quantization",
           experiment="compare the counters of sensor and logger, poll faster"),
    Effect("interpolated_samples", reading=interpolate, comes_last=True,
           equation="y is on a straight line, of order 1, or a smooth curve, of order "
                    "3, through what the sensor gave; it samples at frequency, in Hz, "
                    "below that of the record; phase, in rad, at the first; none if it "
                    "samples between the record's times, at random, or loses samples",
           resembles="bandwidth",
           experiment="look for resampling, or for gaps that were filled, in what "
                      "wrote the file; take the samples as they came"),
    Effect("moving_average", reading=_average, comes_last=True,
           variants=("", ROUNDED),
           equation="the mean of y over a window that ends with the sample; window in "
                    "s, whole sampling intervals; times 2 if it is the mean of means, "
                    "which is a triangular window (Bartlett)",
           resembles="bandwidth",
           experiment="look for zeros of the spectrum at multiples of one over the "
                      "window; switch off what smooths the data"),
    Effect("steep_low_pass", reading=_pass, comes_last=True, variants=("", ROUNDED),
           equation="y passes a Butterworth low-pass of so many poles, three or more; "
                    "half the power passes at cutoff, in Hz; below, a white noise has "
                    "the density that it had before",
           resembles="bandwidth",
           experiment="record at a higher rate, or with another setting of the "
                      "sensor's filter: the spectrum's edge moves with it"),
    Effect("wrong_parameter", factor=1000.0,
           equation="one parameter of the simulator, or all standard deviations, is "
                    "factor times what it says: the middle of a narrow range, the "
                    "nearest end of one wider than by a factor e",
           resembles="correlated noise, bandwidth",
           experiment="compare the Allan deviation with the data sheet, unit by unit"),
)}


def is_known(effect):
    """Is an effect of the catalogue, not a user's own?"""
    return effect is CATALOGUE.get(effect.name)


def in_catalogue(name):
    """The effect of a name."""
    return CATALOGUE[name]


def _pickled(effect):
    """An effect for another process, which has the catalogue, too."""
    if is_known(effect):
        return in_catalogue, (effect.name,)
    return Effect, tuple(effect)


copyreg.pickle(Effect, _pickled)


def columns_for(effect, scene):
    """Names of the columns of a scene beside which an effect is looked for, [""] if it
    needs none.
    """
    named = {name for other in CATALOGUE.values() for name in other.named}
    return [name for name, x in scene.columns.items()
            if np.std(x) > 0.0 and effect.takes(name, named)] if effect.column else [""]


FAMILIES = (    # effects that a record may show to be one of them, but not which
    ("temperature", "thermal_lag"), ("latency", "lag"),
    ("bias_step", "pulse", "gradual_step"), ("sinusoid", "narrow_band_noise"),
    ("ringing", "vibration_burst"),
    ("rate_ramp", "second_order_drift", "turn_on_transient"),
    ("noise_step", "noise_ramp", "noise_sensitivity"),
    ("random_walk", "correlated_noise", "bias_instability", "random_telegraph",
     "random_steps"))
