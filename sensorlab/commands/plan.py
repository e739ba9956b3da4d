"""python -m sensorid plan"""

import numpy as np

from sensorid import default_hypotheses
from sensorlab.commands.progress import progress_bar
from sensorlab.commands.shared import (
    check_memory, check_outputs, hypothesis_names, read_each, refuse_effects, targets,
    write_json)
from sensorlab.drawings import matplotlib_for_files, save
from sensorlab.drawings.style import AFTER, BEFORE, INK, styled
from sensorlab.modelfiles import read_model
from sensorlab.planning import AHEAD, for_longer, length, outlook
from sensorlab.tables import Table, show


RULED_OUT = 0.01    # probability of a hypothesis that is not worth a sentence


def run(options):
    wanted = {name: value for name, (value, *_) in targets(
        "--target-rsd", options.target_rsd, most=1).items()}
    model = read_model(options.model, options.dt) if options.model else None
    refuse_effects(options.model, model)
    names = hypothesis_names(options)
    check_outputs([*options.records, options.model], plot=options.plot,
                  json=options.json)
    plt = matplotlib_for_files() if options.plot else None
    records = read_each(options, model)
    if len(records) > 1:
        raise ValueError(f"plan takes one channel at a time, not {len(records)}")
    (record,) = records
    now = record.dt * len(record.error)
    duration = AHEAD * now if options.duration is None else options.duration
    check_memory(duration / record.dt)
    hypotheses = model.simulator.hypotheses if model else for_longer(
        default_hypotheses(record.error, record.dt, names), max(duration / now, 1.0))
    if not any(p.free for h in hypotheses for p in h.parameters):
        raise ValueError(f"{options.model}: all parameters are known; a range [low, "
                         "high] is needed for what a longer record is to tell")
    chosen = _chosen(hypotheses, wanted)
    outlooks = outlook(record.error, record.dt, hypotheses, duration, options.trials,
                       options.seed, progress_bar)
    lengths = [length(one, chosen[one.label]) for one in outlooks
               if one.label in chosen]
    if options.json:
        write_json(options.json, dict(
            record=dict(file=record.file, column=record.column, dt=record.dt,
                        samples=len(record.error)), trials=options.trials,
            seed=options.seed, quantiles=[0.05, 0.5, 0.95],
            outlook=[one._asdict() for one in outlooks],
            needed=[one._asdict() for one in lengths]))
    if plt:
        save(draw_outlook(outlooks, lengths), options.plot)
    _show(record, duration, outlooks, lengths, options)


def _chosen(hypotheses, wanted):
    """Target by label, from targets by label or by symbol for all that have it."""
    labels = {f"{h.name}.{p.symbol}": p.symbol for h in hypotheses
              for p in h.parameters if p.free}
    for name in wanted:
        if name not in labels and name not in labels.values():
            raise ValueError(f"--target-rsd {name}: there is " + ", ".join(
                dict.fromkeys([*labels.values(), *labels])))
    return {label: wanted.get(label, wanted.get(symbol))
            for label, symbol in labels.items() if label in wanted or symbol in wanted}


def _show(record, duration, outlooks, lengths, options):
    times = outlooks[0].time
    shown = np.unique(np.linspace(0, len(times) - 1, 4).round().astype(int))
    rows = tuple((one.label, f"{one.probability:.3f}", f"{one.now:.3f}", *(
        f"{middle:.3f} [{low:.3f}, {high:.3f}]" for low, middle, high in
        one.rsd[:, shown].T)) for one in outlooks)
    own = {one.label: one for one in outlooks}
    show(f"{record.heading}, {record.dt * len(record.error):g} s",
         f"relative standard deviation against record length; half of {options.trials} "
         "sensors that this record may be of have less, [5 %, 95 %]; seed "
         f"{options.seed}",
         Table(("parameter", "probability", "now", *(f"{times[i]:.4g} s"
                                                     for i in shown)), rows,
               tuple(range(1, 3 + len(shown))), keys=1),
         *(_sentence(one, own[one.label], duration) for one in lengths
           if own[one.label].probability >= RULED_OUT))


def _sentence(one, own, limit):
    symbol, name = one.label.rpartition(".")[2], one.label.rpartition(".")[0]
    start = (f"if it is a {name} (probability {own.probability:.2f}), {symbol} is "
             f"known to {100 * own.now:.3g} % now")

    def time(t):
        return f"{t:.4g} s" if np.isfinite(t) else f"more than {limit:g} s"
    low, high = map(time, one.interval)
    if own.time[0] >= one.interval[1]:
        return f"{start}: {100 * one.target:g} % is met already"
    if np.isfinite(one.duration):
        return (f"{start} and to {100 * one.target:g} % after {time(one.duration)} "
                f"[{low}, {high}]")
    return (f"{start}; {100 * one.target:g} % is not within {limit:g} s "
            f"[{low}, {high}]: there it is {100 * one.reached[1]:.3g} % "
            f"[{100 * one.reached[0]:.3g}, {100 * one.reached[2]:.3g}]")


@styled
def draw_outlook(outlooks, lengths):
    """Relative standard deviation of every parameter against record length."""
    from matplotlib.figure import Figure
    columns = min(len(outlooks), 3)
    lines = -(-len(outlooks) // columns)
    fig = Figure(figsize=(4.0 * columns, 2.9 * lines + 0.4), layout="constrained")
    axes = fig.subplots(lines, columns, squeeze=False, sharex=True)
    for ax in axes.flat[len(outlooks):]:
        ax.set_axis_off()
    for ax, one in zip(axes.flat, outlooks):
        low, middle, high = one.rsd
        ax.fill_between(one.time, low, high, color=AFTER, alpha=0.25, linewidth=0,
                        label="90 % of such sensors")
        ax.loglog(one.time, middle, "-", color=AFTER, label="half of them")
        ax.plot(one.time[0], one.now, "o", color=INK, label="this record")
        for target in [n.target for n in lengths if n.label == one.label]:
            ax.axhline(target, color=BEFORE, linestyle="--", label="target")
        ax.set_title(f"{one.label}, probability {one.probability:.2f}",
                     fontsize="small")
    for ax in axes[-1]:
        ax.set_xlabel("record length, s")
    for ax in axes[:, 0]:
        ax.set_ylabel("relative standard deviation")
    axes[0, 0].legend(fontsize="x-small")
    return fig
