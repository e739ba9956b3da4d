"""A diagnosis as a table for people, and as JSON for programs."""

import numpy as np

from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.causes import LISTED_FROM
from sensorlab.gap.closure import LAGS
from sensorlab.gap.places import FAR_OUT, UNITS
from sensorlab.gap.verdict import SURE, present


def finite(x):
    """A value for JSON: None for a number that there is not."""
    if isinstance(x, dict):
        return {name: finite(v) for name, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [finite(v) for v in x]
    if x is None or isinstance(x, (str, int)):
        return x
    return float(x) if np.isfinite(x) else None


def outstanding(gap):
    """Of every place the statistic that stands out most, largest first."""
    places = np.array(gap.statistics.place)
    best = [int(np.flatnonzero(places == place)[
        np.abs(gap.distance[places == place]).argmax()])
        for place in gap.p_place]
    return sorted(best, key=lambda i: -abs(gap.distance[i]))


def report(d, record):
    """Contents of report.json for a diagnosis of a `Record`."""
    s = d.before.statistics
    return finite(dict(
        record=dict(file=record.file, column=record.column, samples=len(record.error),
                    dt=record.dt),
        verdict=d.verdict,
        gap=dict(p_value=d.before.p_value, residual_p_value=d.after.p_value,
                 **_closure(d.closure), along_the_filter=d.directed,
                 closed_by_any_noise=d.by_any, nats_per_sample=d.nats_per_sample,
                 remainder=dict(share=d.remainder.share, p_value=d.remainder.p_value,
                                where=_place(s, d.remainder.where)),
                 drift=[one._asdict() for one in d.drift],
                 held_out=d.held_out and _held_out(d.held_out)),
        found=[dict(effect=one.name, column=one.column or None,
                    variant=one.variant or None, share=part.share, needed=part.stays,
                    probability=present(d.causes).get(one.name, 0.0),
                    parameters=_parameters(one.values))
               for one, part in zip(d.found, d.parts)],
        where=[dict(**_place(s, i), before=abs(float(d.before.distance[i])),
                    after=abs(float(d.after.distance[i])),
                    p_value=d.before.p_place[s.place[i]],
                    residual_p_value=d.after.p_place[s.place[i]])
               for i in outstanding(d.before)],
        causes=[dict(effect=c.effect, column=c.column or None,
                     variant="+".join(one.variant for one in c.found if one.variant)
                     or None,
                     probability=c.probability, log_bayes_factor=c.log_bayes,
                     parameters=_parameters(c.parameters))
                for c in d.causes],
        needed_duration=d.needed_duration))


def _closure(c):
    return dict(before=c.before, after=c.after, closed=c.closed,
                closed_interval=c.interval)


def _held_out(h):
    return dict(gain=h.gain, reference=h.reference, ratio_before=h.ratio_before,
                ratio_after=h.ratio_after, **_closure(h.closure))


def _parameters(values):
    return {name: dict(mean=mean, sd=sd) for name, (mean, sd) in values.items()}


def _place(s, i):
    """Where statistic number i looks; None for no statistic."""
    return None if i < 0 else dict(place=s.place[i], at=s.at[i],
                                   column=s.column[i] or None)


# ---- the table

FACTORS = {9.80665: "g taken for m/s^2", 57.29578: "deg taken for rad",
           3600.0: "per hour taken for per second", 60.0: "per root hour taken for "
           "per root second", 1000.0: "milli left out"}


def looks_like(factor, sd, dt):
    """What a wrong factor usually is."""
    named = {**FACTORS, 1.0 / dt: "the sampling rate",
             dt**-0.5: "root of the rate: a density taken for a per-sample sigma, or "
             "the other way round"}
    for value, text in named.items():
        for v in (value, 1.0 / value):
            if abs(factor - v) < max(3.0 * sd, 0.03 * v) and sd < 0.2 * v \
                    and abs(np.log(v)) > 0.2:
                return f"about {v:.4g}: {text}"
    return ""


def table(d, record, unit):
    """The diagnosis as a table for a terminal."""
    lines = [f"{record.heading}; beside it: {', '.join(record.columns) or 'nothing'}",
             *_verdict(d), *_causes(d, record.dt, unit), *_where(d), *_closed(d, unit),
             *_advice(d)]
    return "\n".join(lines) + "\n"


def described(d, h, unit):
    """The error model of a record as a sum, as text: a hypothesis and what was found.
    """
    def sizes(values):
        return ", ".join(
            f"{name} {mean:.4g}" + (f" +- {sd:.2g}" if sd else "")
            if np.isscalar(mean) and not isinstance(mean, str) else f"{name} {mean}"
            for name, (mean, sd) in values.items())
    rows = [(h.name, "", sizes({p.symbol: (p.mean, p.sd) for p in h.parameters}))]
    rows += [(one.name, f"{100 * part.share:.0f} %", sizes(one.values))
             for one, part in zip(d.found, d.parts)]
    width = max(len(name) for name, *_ in rows) + 2
    lines = [f"{'component':<{width}}{'share':>6}  size, in {unit}, s, Hz", *(
        f"{name:<{width}}{share:>6}  {text}" for name, share, text in rows)]
    if "unknown" not in d.verdict:
        lines.append("their sum describes the record: a remainder as large has the "
                     f"chance {d.remainder.p_value:.2g}")
    else:
        lines.append(f"{100 * d.remainder.share:.0f} % of what white noise, walk and "
                     f"Markov process leave is not described: {_look_at(d)}")
    return "\n".join(lines)


def _look_at(d):
    """Where most of what is left stands out."""
    i, s = outstanding(d.after)[0], d.before.statistics
    return f"look at {s.place[i].replace('_', ' ')}, {_at(s, i)}"


def _verdict(d):
    yield f"verdict: {d.verdict}" + (
        ", alone or with another effect" if d.causes[0].probability < SURE
        and d.verdict != "undecided" else "")
    if d.before.p_value > 0.05 and d.verdict == "none":
        yield ("the simulator describes the record: a gap as large has the "
               f"chance {d.before.p_value:.2g}")
    elif d.before.p_value > 0.05:
        yield ("no place stands out by itself (a gap as large has the chance "
               f"{d.before.p_value:.2g}): only the search for each effect tells")
    else:
        yield (f"gap: {d.closure.before:.3g} standard deviations where it stands out "
               f"(p = {d.before.p_value:.2g}; 1 is no gap)")


def _causes(d, dt, unit):
    shown = {c.effect + (f" ({c.column})" if c.column and c.column not in c.effect
                         else ""): c for c in d.causes[:6]
             if c.probability >= LISTED_FROM or c.effect in ("none", "unknown")}
    width = max(map(len, shown)) + 2
    yield f"{'cause':<{width}}probability    ln B  size, in {unit}, s, Hz"
    for name, c in shown.items():
        log_bayes = "" if c.effect in ("none", "unknown") else f"{c.log_bayes:.1f}"
        yield f"{name:<{width}}{c.probability:>11.3f}{log_bayes:>8}  {_words(c, dt)}"


def _words(c, dt):
    """Parameters of a cause as text."""
    parts = []
    for name, (mean, sd) in c.parameters.items():
        if isinstance(mean, list):
            shown = mean if len(mean) <= 2 else f"{len(mean)} of them"
            parts.append(f"{name} {shown}")
        elif isinstance(mean, str):
            parts.append(mean)
        else:
            parts.append(f"{name} {mean:.4g}" + (f" +- {sd:.2g}" if sd else ""))
    parts += [looks_like(*value, dt) for name, value in c.parameters.items()
              if name.split(".")[-1] == "factor"]
    return ", ".join(filter(None, parts))


def _where(d):
    yield (f"{'where':<16}{'at':<30}{'before':>8}{'after':>8}{'p':>10}"
           "   standard deviations")
    s = d.before.statistics
    for i in outstanding(d.before):
        before, after = (abs(g.distance[i]) for g in (d.before, d.after))
        yield (f"{s.place[i]:<16}{_at(s, i):<30}{before:>8.1f}{after:>8.1f}"
               f"{d.before.p_place[s.place[i]]:>10.2g}")


def _at(s, i):
    """Where statistic number i looks, as text."""
    (low, high), unit = s.at[i], s.column[i] or UNITS[s.place[i]]
    if s.place[i] == "amplitude" and low == high == 0.0:
        return "equal neighbours"
    if s.place[i] == "amplitude" and max(-low, high) >= FAR_OUT:
        if high - low >= 2.0 * FAR_OUT:
            return "all of it"
        if low <= -FAR_OUT:
            return f"below {high:.3g} {unit}"
        return f"beyond {low:.3g} {unit}"
    return (f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}") + f" {unit}"


def _closed(d, unit):
    if d.found and np.isfinite(d.closure.closed):
        yield (f"closed by adding {added_names(d)}: {_percent(d.closure)} of the gap"
               + ", as the effect itself shows it" * d.directed
               + f", {d.nats_per_sample:.2g} nats a sample; left: p = "
               f"{d.after.p_value:.2g}, {100 * d.remainder.share:.0f} % of the gap")
        if np.isfinite(d.by_any):
            yield (f"noise of any colour and spread would close {100 * d.by_any:.0f} %:"
                   " to close a gap does not prove the name")
    if len(d.found) > 1:
        yield "each of them, taken out again, opens: " + ", ".join(
            f"{one.name} {100 * part.share:.0f} %"
            for one, part in zip(d.found, d.parts))
    for one in d.drift if d.found or d.verdict == "unknown" else ():
        yield (f"error integrated over {one.horizon:g} s: rms {one.record:.3g} {unit} "
               f"s; simulated {one.simulator:.3g}"
               + (f", with {added_names(d)} {one.with_effects:.3g}" if d.found else ""))
    if d.held_out:
        h = d.held_out
        yield ("the last third, by a fit of the others: "
               + (f"closed {_percent(h.closure)}, " if np.isfinite(h.closure.closed)
                  else
                  "nothing stands out, ")
               + f"{h.gain:+.2g} nats a sample (a regression on {LAGS} samples "
               f"and all columns: {h.reference:+.2g}); errors are "
               f"{h.ratio_before:.3g} of what is calculated before, "
               f"{h.ratio_after:.3g} after")


def _percent(part):
    """What is closed of a gap, and its interval, as text."""
    low, high = part.interval
    return f"{100 * part.closed:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def _advice(d):
    """What the effects are confused with, and what to do next."""
    named = [c.effect for c in d.causes if c.effect in CATALOGUE][:2]
    for name in named if d.verdict == "undecided" else named[:1]:
        e = CATALOGUE[name]
        if d.verdict != "none":
            yield f"{name} is confused with {e.resembles}; to tell: {e.experiment}"
    for one in d.found:
        if one.variant and one.column:
            yield (f"{one.name} is that with the {one.variant} of {one.column}, "
                   f"probability {one.share:.2f} among its forms; its size is of that")
        elif one.variant:
            yield (f"{one.name} is of {one.variant}, probability {one.share:.2f} among "
                   "its forms")
    for column in {s.found.column for s in d.final.signatures if s.found.column}:
        low, high = clusters(d.scene.columns[column])
        if high:
            yield (f"{column} is {low[0]:.4g} to {low[1]:.4g} or {high[0]:.4g} "
                   f"to {high[1]:.4g}, never between: whatever else changed "
                   "with it explains the record as well")
    if d.verdict == "undecided":
        yield (f"a record of about {float(f'{d.needed_duration:.2g}'):g} s would "
               "tell the first two apart, if the odds grow as they did")
    if "unknown" in d.verdict:
        yield f"what is left fits no effect of the catalogue: {_look_at(d)}"
        doubtful = [one.name for one, part in zip(d.found, d.parts) if not part.stays]
        if doubtful:
            yield (f"{', '.join(doubtful)} may stand in for it: not needed where it is "
                   "described by any colour and spread")


def clusters(x):
    """Ends of the lower and the upper cluster of a column, the latter () if one is all:
    two are apart by more than half of the range.
    """
    x = np.sort(x)
    at = int(np.diff(x).argmax())
    if x[at + 1] - x[at] < 0.5 * (x[-1] - x[0]):
        return (x[0], x[-1]), ()
    return (x[0], x[at]), (x[at + 1], x[-1])


def added_names(d):
    """The effects that were added, as one name."""
    return "+".join(one.name for one in d.found) or "nothing"
