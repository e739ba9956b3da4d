"""The pictures of `criteria`: against record length, and of the length needed."""

import numpy as np

from sensorlab.drawings.style import INK, legend_above, new_figure, styled


@styled
def draw_criteria(result):
    """Error probability and RSD against time."""
    fig, (left, right) = new_figure(10.0, 4.8, 2)
    for ax, curves in ((left, [("error probability", result.error_probability)]),
                       (right, list(zip(result.labels, result.rsd)))):
        for number, (label, c) in enumerate(curves):
            color = f"C{number}"
            ax.plot(result.time, c.real, "-", color=color, label=label)
            ax.plot(result.time, c.calculated, "--", color=color)
            ax.fill_between(result.time, c.real - c.real_se, c.real + c.real_se,
                            color=color, alpha=0.2, linewidth=0)
        ax.plot([], [], "-", color="0.4", label="real, ± standard error")
        ax.plot([], [], "--", color="0.4", label="calculated")
    for number, (name, r) in enumerate(result.rivals.items(), 1):
        left.plot(result.time, r.error_probability, ":o", color=f"C{number}",
                  markersize=3, label=name)
        for label, c in enumerate(r.rsd):
            right.plot(result.time, c, ":", color=f"C{label}", linewidth=0.8)
    if result.rivals:
        right.plot([], [], ":", color="0.4", label="other algorithms")
    left.set(xlabel="record length, s", ylabel="probability of a wrong model")
    right.set(xlabel="record length, s", ylabel="relative standard deviation")
    for ax, title in ((left, "Structure"), (right, "Parameters")):
        legend_above(ax, title)
        ax.set_ylim(bottom=0)
    return fig


@styled
def draw_design(rows, limit, unit):
    """Needed duration against one condition, a line for each value of the other."""
    labels = list(dict.fromkeys((r["label"], r["target"]) for r in rows))
    several = len({r["sigma_v"] for r in rows}) > 1
    x, other = ("sigma_v", "dt") if several else ("dt", "sigma_v")
    fig, axes = new_figure(1.0 + 4.6 * len(labels), 4.6, len(labels))
    for ax, (label, target) in zip(axes, labels):
        any_never = False
        for number, value in enumerate(dict.fromkeys(r[other] for r in rows)):
            own = [r for r in rows if (r["label"], r["target"], r[other]) == (
                label, target, value)]
            at, needed = np.array([[r[x], r["duration"]] for r in own]).T
            low, high = np.clip([r["interval"] for r in own], None, limit).T
            never, name = np.isnan(needed), None if value is None else (
                f"dt = {value:g} s" if several else f"sigma_v = {value:g} {unit}")
            if not never.all():
                ax.plot(at, needed, "o-", color=f"C{number}", label=name)
            ax.fill_between(at, low, high, color=f"C{number}", alpha=0.15, linewidth=0)
            ax.plot(at[never], np.full(never.sum(), limit), "^", color=f"C{number}",
                    label=name if never.all() else None)
            any_never = any_never or never.any()
        ax.set(xscale="log", yscale="log", ylabel="needed record length, s",
               xlabel=f"white noise sigma_v, {unit}" if several else
               "sampling interval, s")
        if any_never:
            ax.plot([], [], "^", color=INK, label=f"not within {limit:g} s")
        legend_above(ax, f"{label.replace('error_p', 'error p')} of {target:g}")
    return fig
