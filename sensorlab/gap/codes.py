"""Codes of a converter that are not all as wide: its differential nonlinearity."""

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import nnls
from scipy.special import gammaln, logsumexp, ndtr

from sensorlab.gap.values import (
    CERTAIN, NOISY, SMOOTH_OVER, TELLING, less_rounding, noise_where_calm,
    spread_where_calm, unpredicted)

MOST_CODES = 1000    # about the median, that are looked at
FEW_CODES = 100      # if noise is over few of them
FAR = 0.001          # of the samples, at either end, that are not
UNEVEN = np.geomspace(1.0, 100.0, 17)    # 1 / variance of widths, in lsb^2


def uneven_codes(y, lsb):
    """Codes [value, width] of a converter, and the log odds that their widths are not
    all the same; [] if nothing speaks for it.

    A code is met the more often the wider it is (J. Doernberg, H.-S. Lee, D. A. Hodges,
    "Full-speed testing of A/D converters", IEEE J. Solid-State Circuits 19, 1984), and
    noise over several codes makes the law of the values smooth, whatever else is in
    them: counts are Poisson about it, or about it times widths of a gamma law. Noise
    over few codes must be nearly normal for that.
    """
    first, count, smooth = _counted(y, lsb)
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


def odds_to_even(y, lsb, codes):
    """Log odds that a record has codes [value, width], to codes that are all as wide;
    what they say of codes that it does not meet says nothing.
    """
    first, count, smooth = _counted(y, lsb)
    value, width = np.transpose(codes)
    at = np.round((value - first) / lsb).astype(int)
    met, own = (at >= 0) & (at < len(count)), np.ones(len(count))
    own[at[met]] = width[met] / lsb
    own *= smooth.sum() / max(own @ smooth, np.finfo(float).tiny)
    return float(count @ np.log(own))


def _counted(y, lsb):
    """The first of the codes about the median of a record, how often each is met, and
    is to be expected, were all as wide; none where noise is over too few of them.
    """
    y = y[~np.isnan(y)]
    smooth_over, noise = noise_where_calm(y) >= SMOOTH_OVER * lsb, 0.0
    if not smooth_over:
        noise = _least_noise(y, lsb) / lsb
        if noise < 1.0 / NOISY:
            return 0.0, np.zeros(0, int), np.zeros(0)
    first, middle, last = np.quantile(y, [FAR, 0.5, 1.0 - FAR], method="nearest")
    reach = lsb * ((MOST_CODES if smooth_over else FEW_CODES) // 2)
    near = y[(y >= max(first, middle - reach)) & (y <= min(last, middle + reach))]
    first = near.min()
    count = np.bincount(np.round((near - first) / lsb).astype(int))
    return first, count, (_smooth_law(count) if smooth_over else
                          _mixed_law(count, noise))


NORMAL = 0.8    # of the standard deviation of the noise, at least, that is normal


def _least_noise(y, lsb):
    """Standard deviation of a normal noise that every sample has at least, whatever was
    before: in the calmest parts, of what cannot be foretold and of what is new.
    """
    left = unpredicted(y[:TELLING])
    if left is None:
        return 0.0
    noise = min(spread_where_calm(left), noise_where_calm(y))
    return NORMAL * less_rounding(noise, lsb)


TILTED = 4    # powers of the value in the logarithm of what makes a law another


def _mixed_law(count, noise):
    """Expected counts (n,) of codes under the most likely law that a normal noise of so
    many codes allows: any mixture of such (N. Laird, "Nonparametric maximum likelihood
    estimation of a mixing distribution", J. Am. Stat. Assoc. 73, 1978), tilted, as a
    noise may be a little skewed, or have tails.
    """
    n = len(count)
    law = most_likely_mixture(count, normal_shares(n, noise))
    return _fitted(count, np.polynomial.legendre.legvander(
        np.linspace(-1.0, 1.0, n), TILTED), np.zeros(TILTED + 1), law)


def normal_shares(n, noise, before=0):
    """Shares (n, k) of normal laws, of a standard deviation of so many codes, that n
    codes have, if the laws are all about those but so many of the first.
    """
    middle = np.arange(before - REACH * noise, n - 1.0 + REACH * noise, APART * noise)
    ends = (np.arange(n + 1)[:, None] - 0.5 - middle) / noise
    return np.diff(ndtr(ends), axis=0)


REACH, APART = 2.5, 0.5    # standard deviations: of laws beyond codes, between laws
REWEIGHTED = 30     # times, until the most likely law is found
LEAST = 0.01        # counts that are expected of a code
RIDGE = 1e-3        # standard deviations of a weight, inverse: laws so near are alike


def most_likely_mixture(count, share):
    """Expected counts (n,) of codes under the most likely mixture of laws, of which
    codes have shares (n, k), by least squares in the variances of Poisson counts.
    """
    law, ridge = np.maximum(count, 1.0), RIDGE * np.eye(share.shape[1])
    wanted = np.zeros(len(count) + len(ridge))
    for _ in range(REWEIGHTED):
        scale = 1.0 / np.sqrt(law)
        wanted[:len(count)] = count * scale
        weight = nnls(np.vstack([share * scale[:, None], ridge]), wanted)[0]
        law, last = np.maximum(share @ weight, LEAST), law
        if np.abs(law - last).max() < 0.01 * np.sqrt(law.max()):
            break
    return law


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
        step = np.linalg.solve(basis.T @ (own[:, None] * basis)
                               + FLAT * np.eye(len(at)), slope)
        at += step / max(np.abs(basis @ step).max() / NEWTON_NATS, 1.0)
    return law * np.exp(basis @ at)


NEWTON_STEPS = 20
NEWTON_NATS = 2.0    # that a law changes in one of them, at most
FLAT = 1e-3    # weight of a prior of the coefficients: where nothing was counted
