"""Products and sums in an order of their own, exponentials abreast, spectra."""

import math

import numpy as np
from numba import njit

from sensorid import INSIDE
from sensorlab.gap.kernels.lanes import KERNEL, in_rows, in_threads

WHOLE = 1.5 * 2.0**52    # a number that is added to it is rounded to the last bit
PER_LN_2 = 1.0 / math.log(2.0)
LN_2 = 0.6931471803691238, 1.9082149292705877e-10    # in two parts, the first short


@njit(**INSIDE)
def exponentials(x, power, bits):
    """exp of x (lanes,) up to 0 in place, to 1e-15 of it, below -708 as there: that of
    a library takes one number at a time. Powers of two are made in `power` (lanes,), of
    which `bits` are whole numbers in the same place.
    """
    for g in range(len(x)):
        x[g] = x[g] if x[g] > -708.0 else -708.0    # of `max` there are no vectors
        power[g] = x[g] * PER_LN_2 + WHOLE
    for g in range(len(x)):
        n = power[g] - WHOLE
        r = (x[g] - n * LN_2[0]) - n * LN_2[1]
        high = 1 / 5040 + r * (1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * (
            1 / 39916800 + r * (1 / 479001600 + r * (1 / 6227020800))))))
        x[g] = 1.0 + r * (1.0 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (
            1 / 120 + r * (1 / 720 + r * high))))))
    for g in range(len(x)):
        bits[g] = (bits[g] + 1023) << 52    # 2^n
    for g in range(len(x)):
        x[g] *= power[g]


def row_products(rows, columns):
    """rows @ columns.T, each product in an order of its own for any number of threads.
    """
    result = np.zeros((len(rows), len(columns)))
    arguments = *in_rows(rows, columns), result
    if rows.size * len(columns) < LITTLE:
        _multiply_rows(0, len(rows), *arguments)
    else:
        in_threads(_multiply_rows, len(rows), *arguments)
    return result


LITTLE = 10**6    # products that take less time than to wake a thread
CACHED = 2048    # samples of rows and columns that a cache holds


@njit(**KERNEL)
def _multiply_rows(first, last, rows, columns, result):
    """Two rows and four columns at a time: what is loaded is used more than once."""
    C, N = columns.shape
    for begin in range(0, N, CACHED):
        part = slice(begin, min(begin + CACHED, N))
        for c in range(0, C, 4):
            four = [columns[min(c + k, C - 1), part] for k in range(4)]
            for m in range(first, last, 2):
                both = _eight_products(rows[m, part], rows[min(m + 1, last - 1), part],
                                       four[0], four[1], four[2], four[3])
                for row in range(min(2, last - m)):
                    for k in range(min(4, C - c)):
                        result[m + row, c + k] += both[row][k]


SUMS = dict(INSIDE, nogil=True, fastmath={"contract", "reassoc"})    # in the order of
                                                                     # the lanes


@njit(**SUMS)
def dot(a, b):
    """Sum of a times b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(**SUMS)
def _eight_products(r, q, a, b, c, d):
    """Sums of r and of q times each of four columns."""
    ra = rb = rc = rd = qa = qb = qc = qd = 0.0
    for i in range(len(r)):
        ra += r[i] * a[i]
        rb += r[i] * b[i]
        rc += r[i] * c[i]
        rd += r[i] * d[i]
        qa += q[i] * a[i]
        qb += q[i] * b[i]
        qc += q[i] * c[i]
        qd += q[i] * d[i]
    return (ra, rb, rc, rd), (qa, qb, qc, qd)


@njit(**INSIDE)
def spectrum(a, q, turn):
    """Spectrum of a sum of one-state processes at turn = |1 - exp(-i w)|^2."""
    S = 0.0
    for s in range(len(a)):
        S += (q[s] / ((1.0 - a[s])**2 + a[s] * turn)).real
    return S
