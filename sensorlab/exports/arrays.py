"""Noises, jumps and readings of a model as a file of Python that needs NumPy alone."""

import numpy as np

from sensorlab.exports.text import Choice, export

FUNCTION = '''
def simulate(samples, trials=1, rng=None):
    """Errors (trials, samples) of the {kind}, {unit}, every {dt:g} s."""
    rng = np.random.default_rng() if rng is None else rng
    Phi, Gamma, H = np.array({Phi}), np.array({Gamma}), np.array({H})
    variance, axes = np.linalg.eigh(np.array({P0}))
    x = np.array({m0}) + (rng.standard_normal((trials, len(H)))
                         * np.sqrt(np.maximum(variance, 0.0))) @ axes.T
    y = {Psi!r} * rng.standard_normal((trials, samples))
    for i in range(samples):
        x = x @ Phi.T + rng.standard_normal((trials, Gamma.shape[1])) @ Gamma.T
        y[:, i] += x @ H
    y += {bias!r} * rng.standard_normal((trials, 1)){more}
    return y'''

OUTLIERS = '''
    far = rng.random(y.shape) < {rate!r}
    y[far] += {sigma!r} * rng.standard_normal(far.sum())'''
LEVELS = '''
    level = rng.integers(2, size=(trials, 1)) + np.cumsum(
        rng.random(y.shape) < {begin!r}, axis=1)
    y += {half!r} * (2.0 * (level % 2) - 1.0)'''
STEPS = '''
    y += {sigma!r} * np.cumsum((rng.random(y.shape) < {begin!r})
                               * rng.standard_normal(y.shape), axis=1)'''
BURSTS = '''
    loud = rng.random(trials) < {share!r}
    for i in range(samples):
        loud = rng.random(trials) < np.where(loud, 1.0 - {end!r}, {begin!r})
        y[:, i] += {sigma!r} * loud * rng.standard_normal(trials)'''
LIMITS = "\n    y = np.clip(y, {low!r}, {high!r})"
ROUNDING = "\n    y = {lsb!r} * np.round(y / {lsb!r})"


def numpy(axes, choice=Choice()):
    """A module with a function for each axis."""
    body = ["", "import numpy as np", ""]
    for axis in axes:
        body += [_function(axis).replace("def simulate", f"def {axis.kind}"), ""]
    return export(axes, (
        "Convention: Eqs. (1)-(2) of Stepanov and Motorin, Sensors 2019, 19(9), 1997: "
        "x_i = Phi x_{i-1} + Gamma w_i, y_i = H x_i + bias + Psi v_i, with standard "
        "normal w, v; x_0 from N(m0, P0). All per sample."), body)


def _function(axis):
    filt, own = axis.filt, axis.jumps
    more = ""
    if own.rate:
        more += OUTLIERS.format(rate=own.rate, sigma=own.variance**0.5)
    if own.half:
        more += LEVELS.format(begin=own.begin, half=own.half)
    if own.step:
        more += STEPS.format(begin=own.begin, sigma=own.step**0.5)
    if own.louder:
        more += BURSTS.format(share=own.share, begin=own.begin, end=own.end,
                              sigma=own.louder**0.5)
    if np.isfinite(axis.limits).any():
        low, high = (float(v) if np.isfinite(v) else None for v in axis.limits)
        more += LIMITS.format(low=low, high=high)
    more += ROUNDING.format(lsb=float(axis.lsb)) * bool(axis.lsb)
    return FUNCTION.format(
        kind=axis.kind, unit=axis.unit, dt=axis.dt, Phi=filt.Phi[0].tolist(),
        Gamma=filt.Gamma[0].tolist(), H=filt.H[0].tolist(), P0=filt.P0.tolist(),
        m0=filt.m0.tolist(), Psi=float(filt.Psi.max()), bias=float(axis.bias),
        more=more)
