"""Figures 7 and 8: the other algorithms on the trials of the Bayesian one, cases 1-3.

Both are of `compute`; the paper leaves this comparison to the future (Sec. 5).
"""

import functools

import numpy as np

import figures
import sensorid
import sensorlab

NAMES = dict(slopes="Allan slopes", gmwm="Allan least squares (GMWM)", aic="ML, AIC",
             bic="ML, BIC", whittle="Whittle, AIC")


@functools.cache
def _compute(number, trials, dt):
    times = figures.DURATION * 2.0**-np.arange(5.0, -1.0, -1.0)
    case = figures.case(number)
    c = sensorid.criteria(case, dt, figures.DURATION, trials, figures.SEED, times=times,
                          algorithms=sensorlab.ALGORITHMS,
                          checkpoint=figures.OUTPUT / "trials",
                          progress=figures.size["progress"])
    bounds = [sensorlab.estimation_bound(h, dt, times, 4 * trials, figures.SEED)
              for h in case]
    return c, np.hstack([bound for bound, _ in bounds]), np.hstack(
        [se for _, se in bounds])


def compute(number):
    """Criteria of a case, and the bound of every RSD (T, P) with its standard error."""
    return _compute(number, figures.size["trials"], figures.size["dt"])


def label(ax, title):
    ax.set(xlabel="time, s", xscale="log", title=title)
