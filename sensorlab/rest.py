"""Where a sensor was at rest: what it measures of a motion is no error of it."""

import numpy as np

from sensorid import as_samples, check_interval

SECOND = 1.0    # s, within which a motion is large; what a sensor itself does is slower
FEWEST = 20     # samples of a window of that length, at least
WITHIN = 0.1, 0.9    # of the values of a window: outliers lie outside
LARGE = 50.0    # times as wide as in the quietest windows is no noise
QUIETEST = 10.0    # per cent of the windows: some sensors are turned most of the time


def at_rest(error, dt):
    """Stretches of a record in which the sensor was not moved.

    It was, where most values of a second spread over 50 times as much as in the
    quietest tenth of the record: a fast and large change, whatever its cause.

    Parameters
    ----------
    error : array (N,) or (d, N), u
        Record, or those of d axes that are moved together; NaN where missing.
    dt : float, s
        Sampling interval.

    Returns
    -------
    array (K, 2) of int
        First sample of each stretch and that behind its last, in order; one of the
        whole record where nothing moved it or it is too short to tell.

    Raises
    ------
    ValueError
        No record, or no sampling interval.
    """
    check_interval(dt)
    axes = np.atleast_2d(as_samples(error))
    if axes.ndim != 2 or not axes.size:
        raise ValueError(f"the record has shape {np.shape(error)}: one axis (N,) or "
                         "several (d, N) are needed")
    still = ~np.any([_moved(x, dt) for x in axes], axis=0)
    change = np.diff(np.concatenate([[0], still, [0]]))
    return np.column_stack([np.flatnonzero(change == 1), np.flatnonzero(change == -1)])


def _moved(x, dt):
    """Samples (N,) of a record within a second of a motion."""
    half = max(round(SECOND / dt), FEWEST) // 2    # a window overlaps the next by half
    blocks = np.resize(np.where(np.isinf(x), np.nan, x), (len(x) // half, half))
    windows = np.hstack([blocks[:-1], blocks[1:]])
    windows.sort(axis=1)    # what is missing comes last
    known = (~np.isnan(windows)).sum(1)
    low, high = (np.take_along_axis(windows, np.rint(
        part * np.maximum(known - 1, 0)).astype(int)[:, None], 1)[:, 0]
        for part in WITHIN)
    spread = np.where(known, high - low, 0.0)
    moved = np.zeros(len(x), bool)
    if spread.any():
        usual = np.percentile(spread[spread > 0.0], QUIETEST)
        for k in np.flatnonzero(spread > LARGE * usual):
            moved[max(k - 2, 0) * half:(k + 4) * half] = True
        moved[len(blocks) * half:] = moved[len(blocks) * half - 1]
    return moved
