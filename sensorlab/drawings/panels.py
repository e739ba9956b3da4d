"""The panels of a diagnosis, each on axes of its own.

`view` is the `View` of the diagnosis d: what they show is computed there.
"""

import numpy as np

from sensorlab.drawings.style import AFTER, BEFORE, INK, PALE
from sensorlab.gap.curves import block_means, envelope
from sensorlab.gap.words import listed, with_found

POINTS = 1200    # of a line: a picture shows no more
MEANS = 200      # parts of a record whose means show what is slow


def of_record(ax, d, view, unit):
    """The record, and through it what was found, as far as one can see it there."""
    scene, lost = d.scene, lost_samples(d)
    y = np.where(lost, np.nan, scene.y + scene.known)
    part = slice(None) if view.through is None else _around(view.through.y)
    t = scene.time[part]
    ax.plot(*envelope(t, y[part], POINTS), color=PALE, linewidth=0.6, label="record")
    step = len(t) // MEANS
    if step >= 10:
        ax.plot(*block_means(t, y[part], step), color=INK, linewidth=0.8,
                label=f"means of {step * scene.dt:.3g} s")
    if view.through is not None:
        names, through = view.through
        through = through[part] + np.nanmedian(y - through)
        ax.plot(*envelope(t, through, POINTS), color=AFTER, linewidth=1.8,
                label=listed(name.replace("_", " ") for name in names))
    if view.odd.any():
        ax.plot(scene.time[view.odd], y[view.odd], "o", color=BEFORE, fillstyle="none",
                markersize=5, label="outliers")
    if lost.any():
        at = scene.time[lost]
        ax.plot(at, np.zeros(len(at)), "|", transform=ax.get_xaxis_transform(),
                color=AFTER, markersize=10, label="lost samples")
    for one in d.found:
        _mark(ax, one, scene, y)
    beside = 0.02 * (t[-1] - t[0])
    ax.set(xlabel="time, s", ylabel=f"error, {unit}",
           xlim=(t[0] - beside, t[-1] + beside))


BRIEF = 1 / 40    # of a record: what is shorter is shown at large
BESIDE = 8        # times its length, on either side


def _around(through):
    """The slice of a record around an effect that is there for a moment only."""
    there = np.flatnonzero(through)
    if not len(there) or there[-1] - there[0] > BRIEF * len(through):
        return slice(None)
    beside = BESIDE * (there[-1] - there[0] + 4)
    return slice(max(there[0] - beside, 0), there[-1] + beside)


def _mark(ax, one, scene, y):
    """When a change of noise is, where a record is clipped or sticks."""
    if one.effect.model and "onset" in one.values:
        ax.axvline(one.values["onset"][0], color=AFTER, linestyle="--",
                   label=one.name.replace("_", " "))
    for limit in one.values.get("limits", ([], 0.0))[0]:
        if np.isfinite(limit):
            ax.axhline(limit, color=AFTER, linewidth=1.0, label=f"limit {limit:.4g}")
    starts = [start for start, _ in one.values.get("spans", ([], 0.0))[0]]
    if starts and one.name == "stuck":
        at = np.round(np.array(starts) / scene.dt).astype(int)
        ax.plot(scene.time[at], y[at], "v", color=AFTER, label="stuck from here on")


def of_bands(ax, d, banded):
    """A curve of the record, and where those of 90 % of simulated records lie."""
    if not len(banded.x):
        ax.text(0.5, 0.5, "too many samples are missing", ha="center",
                transform=ax.transAxes)
        return
    ax.fill_between(banded.x, *banded.before, color=BEFORE, alpha=0.3, linewidth=1.2,
                    label="90 % of simulated records")
    if banded.after is not None:
        ax.fill_between(banded.x, *banded.after, color=AFTER, alpha=0.35, linewidth=1.2,
                        label=with_found(d))
    ax.plot(banded.x, banded.record, ".-", color=INK, markersize=3, linewidth=0.9,
            label="record")
    ax.set(xscale="log", yscale="log")


def of_allan(ax, d, view, unit):
    """Allan deviation."""
    of_bands(ax, d, view.allan)
    ax.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}")


def of_spectrum(ax, d, view, unit):
    """Root of the one-sided spectral density."""
    of_bands(ax, d, view.spectrum)
    ax.set(xlabel="frequency, Hz", ylabel=f"noise density, {unit}/√Hz")


MOST_DOTS = 1500


def of_added(ax, added):
    """Added-variable plot: what the effect should add, and what the record shows."""
    order = np.argsort(-np.abs(added.expected))    # what tells most
    dots = order[:: max(len(order) // MOST_DOTS, 1)]
    ax.plot(added.expected[dots], added.seen[dots], ".", color=PALE, markersize=2.0,
            alpha=0.5, label="samples", rasterized=True)
    x, y, error = added.means    # which fill the picture; samples may lie outside
    ends = np.array([min(x.min(), 0.0), max(x.max(), 0.0)]) * 1.15
    high = 1.3 * max(np.abs(ends).max(), (np.abs(y) + error).max())
    ax.axhline(0.0, color=BEFORE, linewidth=1.2, label="no effect")
    ax.plot(ends, ends, color=AFTER, linewidth=1.6, label="the effect as found")
    ax.errorbar(x, y, error, fmt="o", color=INK, markersize=4, capsize=2,
                elinewidth=1.0, label="their means, ± standard error")
    low = -high if ends[0] < 0.0 else -0.4 * high
    ax.set(xlabel=f"the {added.name.replace('_', ' ')} should add, sd of a sample",
           ylabel="the record shows, sd", xlim=ends + [-0.05 * high, 0.05 * high],
           ylim=(low, high if ends[1] > 0.0 else 0.4 * high))


EXCERPT = 120    # samples in which one sees single values


def of_values(ax, d, reading, unit):
    """Samples one by one, with the lattice, the limits or the span of a reading."""
    scene, values = d.scene, reading.found.values
    y, N = scene.y + scene.known, len(scene.y)
    middle = N // 2
    if reading.masked.any():    # where most of it is
        middle = int(np.convolve(reading.masked, np.ones(EXCERPT), "same").argmax())
    first = int(np.clip(middle - EXCERPT // 2, 0, max(N - EXCERPT, 0)))
    part = slice(first, min(first + EXCERPT, N))
    own = reading.instead.found.values if reading.instead else {}
    for lsb, colour, whose in ((own.get("lsb"), BEFORE, "the simulator's "),
                               (values.get("lsb"), AFTER, "")):
        for number, level in enumerate(_levels(y, part, lsb) if lsb else ()):
            ax.axhline(level, color=colour, linewidth=0.8, alpha=0.6, label=None if
                       number else f"{whose}multiples of {lsb:.4g} {unit}")
    for limit in values.get("limits", ()):
        if np.isfinite(limit):
            ax.axhline(limit, color=AFTER, label=f"limit {limit:.4g} {unit}")
    ax.plot(scene.time[part], y[part], ".-", color=PALE, markerfacecolor=INK,
            markeredgecolor=INK, linewidth=0.6, markersize=4, label="record")
    masked = np.flatnonzero(reading.masked[part]) + first
    if len(masked) and "limits" not in values:
        ax.plot(scene.time[masked], y[masked], ".", color=BEFORE, markersize=6,
                label=reading.found.name.removesuffix("_samples"))
    ax.set(xlabel="time, s", ylabel=f"error, {unit}")


def of_codes(ax, reading, unit):
    """Widths of the codes of a converter."""
    value, width = np.transpose(reading.found.values["codes"])
    lsb = value[1] - value[0]
    ax.bar(value, width / lsb, 0.8 * lsb, color=PALE, label="record")
    ax.axhline(1.0, color=AFTER, label=f"codes that are all {lsb:.4g} {unit} wide")
    ax.locator_params(axis="x", nbins=5)
    ax.set(xlabel=f"error, {unit}", ylabel="width of a code, lsb")


def _levels(y, part, lsb):
    """Multiples of lsb, from the first value of a record on, about a part of it."""
    first = y[~np.isnan(y)][0]
    low, high = np.nanmin(y[part]), np.nanmax(y[part])
    return first + lsb * np.arange(np.ceil((low - first) / lsb - 0.5),
                                   np.floor((high - first) / lsb + 0.5) + 1)


RESIDUAL_LABELS = dict(
    time=("time, s", "rms of the residuals, sd"),
    frequency=("frequency, Hz", "power of the residuals, 1 if white"),
    averaging_time=("frequency, Hz", "power of the residuals, 1 if white"),
    lag=("lag, s", "correlation of the residuals"),
    amplitude=("residual, sd", "samples over those expected"),
    covariate=("{column}", "mean of the residuals, standard errors"))


def of_residuals(ax, d, view):
    """What the filter of the simulator leaves, where that stands out most."""
    for residual, colour, label in zip(view.residuals, (BEFORE, AFTER), (
            "residuals of the simulator", with_found(d))):
        ax.plot(residual.x, residual.value, ".-", color=colour, markersize=4,
                linewidth=1.0, label=label)
    place = view.residuals[0].place
    x, y = RESIDUAL_LABELS[place]
    ax.set(xlabel=x.format(column=view.residuals[0].column), ylabel=y)
    if place in ("frequency", "averaging_time"):
        ax.set(xscale="log", yscale="log")


WIDE = 30.0    # standard deviations from which on the axis is logarithmic
LEAST = 0.3    # standard deviations: on a logarithmic axis, less is drawn there


def of_places(ax, d, view):
    """How far the record is from simulated ones in every place."""
    at = np.arange(len(view.places))[::-1]
    limit, marks = view.places[0].limit, [
        ([p.before for p in view.places], BEFORE, "simulator", "o")]
    if d.found:
        marks.append(([p.after for p in view.places], AFTER, with_found(d), "D"))
    largest = max(limit, *(max(values) for values, *_ in marks))
    for values, colour, label, mark in marks:
        ax.plot(np.maximum(values, LEAST if largest > WIDE else 0.0), at, mark,
                color=colour, label=label)
    ax.axvline(limit, color=INK, linestyle="--", linewidth=1.0,
               label="by chance, 1 record in 20 goes beyond")
    if largest > WIDE:
        ax.set(xscale="log", xlim=(0.8 * LEAST, 1.4 * largest))
    else:
        ax.set_xlim(0.0, 1.1 * largest)
    ax.set(xlabel="distance from simulated records, sd", ylim=(-0.6, len(at) - 0.4))
    ax.set_yticks(at, [place.name.replace("_", " ") for place in view.places])


def lost_samples(d):
    """Samples (N,) for which the file has a constant."""
    return sum((r.masked for r in d.final.readings if r.found.name == "dropouts"),
               np.zeros(len(d.scene.y), bool))


def readings_found(d):
    """The readings among what was found."""
    kinds = {one.effect.reading for one in d.found}
    return [r for r in d.final.readings if r.found.effect.reading in kinds]


def of_evidence(ax, d, view, unit):
    """The panel that shows best what was found; returns its title."""
    readings = readings_found(d)
    if view.added:
        of_added(ax, view.added[0])
        return f"The {view.added[0].name.replace('_', ' ')} in the record"
    if readings and "codes" in readings[-1].found.values:
        of_codes(ax, readings[-1], unit)
        return "How wide its codes are"
    if readings:
        of_values(ax, d, readings[-1], unit)
        return "The values themselves"
    if d.verdict == "none":
        of_places(ax, d, view)
        return "Where the record differs"
    of_residuals(ax, d, view)
    return "Residuals of the simulator"
