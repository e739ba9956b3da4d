"""The pictures of --plot and of a diagnosis. Matplotlib is imported when asked for."""

import pathlib

import numpy as np
from scipy.special import ndtr

from sensorid import (
    GAMMA, MIN_SAMPLES, allan_deviation, allan_variance, identify, model_allan_variance,
    write_whole)
from sensorlab.gap.account import as_simulated
from sensorlab.gap.effects import signature_of, simulate_effects
from sensorlab.gap.report import outstanding


def matplotlib_for_files():
    """matplotlib.pyplot, or a sentence on what to install."""
    try:
        import matplotlib
    except ImportError:
        raise ValueError("--plot needs Matplotlib: pip install matplotlib") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    return plt


def save(fig, file):
    """Write a picture whole or not at all."""
    fig.set_layout_engine("tight")
    for text in fig.findobj(lambda part: hasattr(part, "set_parse_math")):
        if r"\mathdefault" not in text.get_text():    # a $ of a name is none of ours
            text.set_parse_math("$" not in text.get_text())
    kind = pathlib.Path(file).suffix[1:].lower()
    write_whole(file, lambda stream: fig.savefig(stream, format=kind, dpi=150))


def draw_identify(plt, record, posterior, unit):
    """Allan deviations of the record and of every hypothesis;
    probability against length.
    """
    y, dt = record.error, record.dt
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    tau, adev = allan_deviation(y, dt, per_octave=2)
    left.loglog(tau, adev, "k.-", label="record")
    m = np.unique(np.geomspace(1, max(len(y) // 3, 1), 40).astype(int))
    lengths = [n for n in len(y) // 2**np.arange(6, -1, -1) if n >= MIN_SAMPLES
               and (~np.isnan(y[:n])).sum() >= MIN_SAMPLES
               and np.nanmin(y[:n]) < np.nanmax(y[:n])]
    hypotheses = [e.hypothesis for e in posterior.estimates]
    history = np.array([identify(y[:n], dt, hypotheses).probability for n in lengths])
    for k, e in enumerate(posterior.estimates):
        filt = e.hypothesis.filter(dt, e.mean)
        left.loglog(m * dt, np.sqrt(model_allan_variance(filt, m)),
                    color=f"C{k}",
                    label=f"{e.hypothesis.name}, {posterior.probability[k]:.3f}")
        right.semilogx(np.array(lengths) * dt, history[:, k], "o-", color=f"C{k}",
                       label=e.hypothesis.name)
    right.axhline(GAMMA, color="0.6", linestyle=":", label=f"threshold {GAMMA}")
    left.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}",
             title=f"{pathlib.Path(record.file).name}, {record.column}")
    right.set(xlabel="record length used, s", ylabel="probability of the hypothesis",
              ylim=(-0.03, 1.03), title="Eq. (10)")
    for ax in (left, right):
        ax.legend(frameon=False)
        ax.grid(True, which="major", alpha=0.3)
    return fig


def draw_criteria(plt, result):
    """Error probability and RSD against time."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    for ax, curves in ((left, [("error probability", result.error_probability)]),
                       (right, list(zip(result.labels, result.rsd)))):
        for number, (label, c) in enumerate(curves):
            color = f"C{number}"
            ax.plot(result.time, c.real, "-", color=color, label=label)
            ax.plot(result.time, c.calculated, "--", color=color)
            ax.fill_between(result.time, c.real - c.real_se, c.real + c.real_se,
                            color=color, alpha=0.2, linewidth=0)
        ax.plot([], [], "-", color="0.4", label="real, +- standard error")
        ax.plot([], [], "--", color="0.4", label="calculated")
    for number, (name, r) in enumerate(result.rivals.items(), 1):
        left.plot(result.time, r.error_probability, ":o", color=f"C{number}",
                  markersize=3, label=name)
        for label, c in enumerate(r.rsd):
            right.plot(result.time, c, ":", color=f"C{label}", linewidth=0.8)
    if result.rivals:
        right.plot([], [], ":", color="0.4", label="other algorithms")
    for ax, curves in (left, 2 + len(result.rivals)), (right, 2 + len(result.rsd)):
        ax.set_xlabel("time, s")
        ax.legend(frameon=False, fontsize="small", loc="upper right",
                  ncols=1 + (curves > 5))
        ax.grid(True, alpha=0.3)
        ax.margins(y=0.35 if curves > 5 else 0.05)
        ax.set_ylim(bottom=0)
    left.set_ylabel("identification error probability")
    right.set_ylabel("relative standard deviation")
    return fig


def draw_design(plt, rows, limit, unit):
    """Needed duration against one condition, a line for each value of the other."""
    labels = list(dict.fromkeys((r["label"], r["target"]) for r in rows))
    several = len({r["sigma_v"] for r in rows}) > 1
    x, other = ("sigma_v", "dt") if several else ("dt", "sigma_v")
    fig, axes = plt.subplots(1, len(labels), figsize=(1.0 + 4.6 * len(labels), 4.2),
                             squeeze=False)
    for ax, (label, target) in zip(axes[0], labels):
        for number, value in enumerate(dict.fromkeys(r[other] for r in rows)):
            own = [r for r in rows if (r["label"], r["target"], r[other]) == (
                label, target, value)]
            at = np.array([r[x] for r in own])
            low, high = np.clip([r["interval"] for r in own], None, limit).T
            ax.plot(at, [r["duration"] for r in own], "o-", color=f"C{number}",
                    label=None if value is None else
                    f"dt = {value:g} s" if several else f"sigma_v = {value:g} {unit}")
            ax.fill_between(at, low, high, color=f"C{number}", alpha=0.15, linewidth=0)
            never = at[[r["duration"] != r["duration"] for r in own]]
            ax.plot(never, np.full(len(never), limit), "^", color=f"C{number}")
        ax.set(xscale="log", yscale="log", ylabel="needed record length, s",
               xlabel=f"white noise sigma_v, {unit}" if several else
               "sampling interval, s",
               title=f"{label} of {target:g}")
        ax.plot([], [], "k^", label=f"not within {limit:g} s")
        ax.grid(True, which="both", alpha=0.3)
        ax.legend(frameon=False)
    return fig


def draw_diagnosis(plt, d, record, unit):
    """The record with what was found in it; Allan deviation in the simulated bands
    before and after; residuals where they stand out.
    """
    fig, axes = plt.subplots(1, 3, figsize=(15.0, 4.6))
    fig.suptitle(f"{pathlib.Path(record.file).name}, {record.column}: {d.verdict}",
                 wrap=True)
    _draw_record(axes[0], d, unit)
    _draw_bands(axes[1], d, unit)
    _draw_residuals(axes[2], d)
    for ax in axes:
        ax.grid(True, which="major", alpha=0.3)
        ax.legend(frameon=False)
    return fig


MOST_POINTS = 20000    # of a curve: a picture shows no more


def _draw_record(ax, d, unit):
    """The record, and through it what is known up to a size; where all that was found
    is noise, by how much better each sample is foretold.
    """
    scene, step = d.scene, max(len(d.scene.y) // MOST_POINTS, 1)
    (effects,) = as_simulated(d.final, scene, d.after.theta).effects
    drawn = [one for one in effects if one.effect.columns]
    if not drawn and any(not one.effect.reading for one in d.found):
        gain = np.nancumsum(d.after.log_score - d.before.log_score)
        ax.plot(scene.time[::step], gain[::step], "k-", label="with what was found")
        ax.set(xlabel="time, s", ylabel="log-likelihood gained, nats",
               title="how much better the samples are foretold")
        return
    y = scene.y + scene.known
    ax.plot(scene.time[::step], y[::step], "-", color="0.6", linewidth=0.6,
            label="record")
    if drawn:
        effect = sum(signature_of(scene, one, {
            symbol: p.low for symbol, p in one.values.items()}) for one in drawn)
        ax.plot(scene.time[::step], (effect + np.nanmedian(y - effect))[::step], "-",
                color="tab:blue", label=_brief_names(one.name for one in drawn))
    ax.set(xlabel="time, s", ylabel=unit, title="the record")


def _brief_names(names):
    names = list(dict.fromkeys(names))
    return "+".join(names if len(names) < 3 else [names[0], f"{len(names) - 1} more"])


def _draw_bands(ax, d, unit):
    """Allan deviation of the record, and where that of simulated ones lies."""
    scene = d.scene
    tau, adev = allan_deviation(scene.y, scene.dt)
    m = np.round(tau / scene.dt).astype(int)
    bands = [(d.base, d.before, "tab:red", "simulator, 90 % of its records")]
    if d.found:
        bands.append((d.final, d.after, "tab:blue", "with what was found"))
    for acc, gap, colour, label in bands:
        drawn = simulate_effects(as_simulated(acc, scene, gap.theta), scene, 60, 1
                                 ).error
        curves = np.sqrt([allan_variance(drawn, scene.dt, k) for k in m])
        ax.fill_between(tau, *np.nanquantile(curves, [0.05, 0.95], axis=1),
                        color=colour, alpha=0.3, linewidth=0, label=label)
    ax.loglog(tau, adev, "k.-", label="record")
    ax.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}",
           xscale="log", yscale="log", title="Allan deviation")


def _draw_residuals(ax, d):
    """Residuals of the filter against what they stand out in most."""
    i = outstanding(d.before)[0]
    place, column = d.before.statistics.place[i], d.before.statistics.column[i]
    curves = [(d.before.z, "tab:red", "before" if d.found else "simulator")]
    if d.found:
        curves.append((d.after.z, "tab:blue", "after"))
    for z, colour, label in curves:
        x, value = _residual_curve(z, d.scene, place, column)
        ax.plot(x, value, ".-", color=colour, label=label, alpha=0.8)
    labels = dict(
        time=("time, s", "mean residual, standard errors"),
        frequency=("frequency, Hz", "power of the residuals"),
        averaging_time=("lag, s", "correlation of the residuals"),
        lag=("lag, s", "correlation of the residuals"),
        amplitude=("residual, standard deviations", "samples over those expected"),
        covariate=(column, "mean residual, standard errors"))
    ax.set(xlabel=labels[place][0], ylabel=labels[place][1],
           title=f"residuals, by {place.replace('_', ' ')}")
    if place == "frequency":
        ax.set(xscale="log", yscale="log")


def _residual_curve(z, scene, place, column):
    """Residuals against the coordinate of a place."""
    seen = ~np.isnan(z)
    z0 = np.where(seen, z, 0.0)
    if place == "frequency":
        power = np.abs(np.fft.rfft(z0))**2 / max(seen.sum(), 1)
        edges = np.unique(np.geomspace(1, len(power), 60).astype(int))
        frequency = np.fft.rfftfreq(len(z), scene.dt)
        return ([frequency[a:b].mean() for a, b in zip(edges[:-1], edges[1:])],
                [power[a:b].max() if b - a < 3 else power[a:b].mean()
                 for a, b in zip(edges[:-1], edges[1:])])
    if place in ("lag", "averaging_time"):
        lags = np.arange(1, min(40, len(z) // 4))
        return lags * scene.dt, [np.mean(z0[k:] * z0[:-k]) for k in lags]
    if place == "amplitude":
        edges = np.linspace(-6.0, 6.0, 25)
        count = np.histogram(z0[seen].clip(-5.99, 5.99), edges)[0]
        expected = np.diff(ndtr(edges)) * seen.sum()
        return 0.5 * (edges[1:] + edges[:-1]), (count + 0.5) / (expected + 0.5)
    x = scene.columns[column] if place == "covariate" else scene.time
    parts = [part for part in np.array_split(np.argsort(x, kind="stable"), 32)
             if seen[part].any()]
    return ([x[part].mean() for part in parts],
            [z0[part].sum() / np.sqrt(seen[part].sum()) for part in parts])
