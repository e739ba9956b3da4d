"""A diagnosis in words: sentences and tables that an engineer reads, without theory."""

import collections

import numpy as np

from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.causes import LISTED_FROM
from sensorlab.gap.closure import LAGS
from sensorlab.gap.places import FAR_OUT, UNITS
from sensorlab.gap.remainder import SLIGHT
from sensorlab.gap.sizes import (
    chance, number, odds, percent, sizes, unit_of, values_text)
from sensorlab.gap.values import lattice_between
from sensorlab.gap.verdict import SURE, names_in, present, split_families
from sensorlab.gap.wrong import ALL
from sensorlab.tables import Table, as_text


# ---- the verdict

PHRASES = dict(
    rate_ramp="a rate ramp", bias_step="a bias step", pulse="a pulse",
    gradual_step="a gradual bias step", ringing="a ringing",
    vibration_burst="a burst of vibration", sinusoid="a sinusoid",
    second_order_drift="a second-order drift", turn_on_transient="a turn-on transient",
    temperature="a dependence on temperature",
    thermal_lag="a dependence on temperature that lags behind",
    scale_factor="a scale factor error",
    thermal_scale_factor="a scale factor that changes with the temperature",
    misalignment="a misalignment of the axes", nonlinearity="a nonlinearity",
    latency="a latency", lag="a lag behind a column", g_sensitivity="a g-sensitivity",
    covariate="a dependence on a column", hysteresis="a hysteresis",
    random_walk="a random walk", correlated_noise="correlated noise",
    bias_instability="bias instability (flicker noise)",
    bandwidth="a limited bandwidth", noise_step="a change of the noise",
    noise_ramp="white noise that grows or fades",
    noise_sensitivity="white noise whose strength follows a column",
    walk_step="a change of what drives the random walk",
    outliers="outliers", noise_bursts="bursts of noise",
    random_telegraph="random telegraph noise", random_steps="random steps",
    differential_nonlinearity="codes of uneven width (differential nonlinearity)",
    quantization="quantization", integral_quantization="quantization of the integral",
    saturation="saturation", stuck="stuck samples",
    dropouts="dropouts (lost samples for which the file has a constant)",
    moving_average="a moving average",
    steep_low_pass="a steep low-pass",
    wrong_parameter="the right value of a parameter",
    unknown="something that no effect of the catalogue explains")

BESIDE = dict(    # the column that was found
    covariate="a dependence on", hysteresis="a hysteresis in",
    lag="a lag behind", misalignment="a misalignment that couples in",
    noise_sensitivity="white noise whose strength follows")


def phrase(effect, found=()):
    """An effect as one says it; with the column or the parameter that was found."""
    one = next((f for f in found if f.name == effect), None)
    if one and effect in BESIDE:
        return f"{BESIDE[effect]} {one.column}"
    if one and effect == "wrong_parameter" and "parameter" in one.values:
        effect, _, symbol = one.values["parameter"][0].rpartition(".")
        if symbol == ALL:
            return "the right scale of all its standard deviations"
        form = "form and " * ("form" in one.values)
        return f"the right {form}{symbol} of its {effect.replace('_', ' ')}" if (
            effect) else f"the right value of {symbol}"
    return PHRASES.get(effect, effect.replace("_", " "))


def listed(texts):
    """Texts as one: a, b and c."""
    texts = list(texts)
    return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))


def headline(d):
    """The verdict in a sentence."""
    if d.verdict == "none":
        return "The simulator describes this record: no effect is missing."
    if d.verdict == "undecided":
        rivals = (c for c in d.causes[:3] if c.probability >= LISTED_FROM)
        return "The record does not decide: " + ", ".join(
            f"{listed(phrase(e, c.found) for e in c.effects) or 'nothing missing'} "
            f"({percent(c.probability)})" for c in rivals) + "."
    if d.verdict == "unknown":
        return f"The simulator lacks {PHRASES['unknown']}."
    known = {**present(d.causes), **dict(split_families(d.causes))}
    counted, said = collections.Counter(d.verdict.split("+")), []
    for name, count in counted.items():
        members = tuple(name.split(" or "))
        probability = known.get(members if len(members) > 1 else name, 0.0)
        text = " or ".join(phrase(e, d.found) for e in members)
        if count > 1:
            each = dict.fromkeys(phrase(name, [one]) for one in d.found
                                 if one.name == name)
            text = listed(each) if len(each) == count else f"{count} times {text}"
        said.append(text if name == "unknown" else
                    f"{text} ({percent(min(probability, 1.0))})")
    return f"The simulator lacks {listed(said)}."


def gap_sentence(d):
    """How large the gap is, and whether it may be chance."""
    p = chance(d.before.p_value)
    if d.before.p_value > 0.05 and d.verdict == "none":
        return ("the simulator describes the record: the chance of a gap as large is "
                f"{p}")
    if d.before.p_value > 0.05:
        return (f"no place stands out by itself (the chance of a gap as large is {p}): "
                "only the search for each effect tells")
    return (f"gap: {d.closure.before:.3g} standard deviations where it stands out, "
            f"where 1 is no gap; the chance of one as large is {p}")


def shown_by_both(d):
    """What is no gap, though the simulator lacks it."""
    for one in d.shared:
        at = f" of {number(one.values['frequency'][0])} Hz" if one.effect.columns and (
            "frequency" in one.values) else ""
        yield (f"{one.name}{at} is no gap: the simulator's own records show one like "
               "it")


def with_found(d):
    """What the simulator with effects is called in a picture."""
    names = list(dict.fromkeys(phrase(one.name, [one]) for one in d.found))
    return "with " + (listed(names) if len(names) < 3 else f"{len(d.found)} effects")


def is_named(d):
    """Is anything that was added to the simulator in the verdict?"""
    return any(one.name in names_in(d.verdict) for one in d.found)


# ---- tables

def cause_name(c):
    """Name of a cause with its column, if the name does not hold that already."""
    return c.effect + (f" ({c.column})" if c.column and c.column not in c.effect
                       else "")


def shown_causes(d):
    """The causes that are worth a row."""
    return [c for c in d.causes[:6]
            if c.probability >= LISTED_FROM or c.effect in ("none", "unknown")]


def odds_to_none(c):
    """How much more probable than `none` a cause makes the record, as text."""
    return "" if c.effect in ("none", "unknown") else odds(c.log_bayes)


def causes_table(d, unit):
    """Every cause with its probability and its sizes."""
    return Table(
        ("cause", "probability", "odds to none", "size"), tuple(
            (cause_name(c), f"{c.probability:.3f}", odds_to_none(c),
             sizes_in(c, d, unit)) for c in shown_causes(d)), (1, 2))


def sizes_in(c, d, unit):
    """Sizes of the effects of a cause: as they were found, or of what it has beside
    these alone, for they had other sizes before all were estimated together.
    """
    def kind(one):
        return one.name, one.column, one.variant, one.values.get("parameter")
    own, found = [one for one in c.found if one.values], list(map(kind, d.found))
    if sorted(map(str, map(kind, own))) == sorted(map(str, found)):
        return sizes(d.found, unit, d.scene.dt)
    other = [one for one in own if kind(one) not in found]
    text = sizes(other, unit, d.scene.dt)
    return f"{other[0].name}: {text}" if len(other) == 1 < len(own) else text


def outstanding(gap):
    """Of every place the statistic that stands out most, largest first."""
    places = np.array(gap.statistics.place)
    best = [int(np.flatnonzero(places == place)[
        np.abs(gap.distance[places == place]).argmax()])
        for place in gap.p_place]
    return sorted(best, key=lambda i: -abs(gap.distance[i]))


def places_table(d):
    """Where the record differs from the simulator, before and after."""
    s, gaps = d.before.statistics, (d.before, d.after)[:1 + bool(d.found)]
    return Table(
        ("where", "at", *("before, sd", "after, sd")[:len(gaps)], "chance"), tuple(
            (s.place[i].replace("_", " "), at(s, i), *(
                f"{abs(g.distance[i]):.1f}" for g in gaps),
             chance(d.before.p_place[s.place[i]])) for i in outstanding(d.before)),
        (2, 3, 4))


def at(s, i):
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


def look_at(d):
    """Where most of what is left stands out."""
    i, s = outstanding(d.after)[0], d.before.statistics
    return f"look at {s.place[i].replace('_', ' ')}, {at(s, i)}"


def drift_table(d, unit):
    """rms of the integrated error of the record and of its simulators."""
    named = (with_found(d),) * bool(d.found)
    return Table(
        ("integrated over", f"record, {unit} s", "simulator", *named), tuple(
            (f"{one.horizon:g} s", number(one.record, 3), number(one.simulator, 3),
             *[number(one.with_effects, 3)] * bool(d.found)) for one in d.drift),
        (1, 2, 3))


# ---- how far it closes, what is left, what to do

def closing(d):
    """How far the gap shrinks with what was found, in sentences."""
    if d.found and np.isfinite(d.closure.closed):
        yield (f"closed by adding {added_names(d)}"
               + ", found first but not the most probable now" * _is_other(d)
               + f": {closed_share(d.closure)} of the gap"
               + ", as the effect itself shows it" * d.directed
               + (f"; each sample is predicted {sharper(d.nats_per_sample)}"
                  if d.nats_per_sample else ""))
        if np.isfinite(d.by_any):
            yield (f"noise of any colour and spread would close {percent(d.by_any)}:"
                   " to close a gap does not prove the name")
    if len(d.found) > 1:
        yield "each of them, taken out again, opens: " + ", ".join(
            f"{_with_parameter(one)} {percent(part.share)}"
            for one, part in zip(d.found, d.parts))
    if d.held_out:
        h = d.held_out
        yield ("checked on the last third, by a fit of the rest: "
               + (f"closed {closed_share(h.closure)}, " if np.isfinite(h.closure.closed)
                  else "nothing stands out, ")
               + f"each sample predicted {sharper(h.gain)} (by a regression on {LAGS} "
               f"samples and all columns: {sharper(h.reference)}); prediction errors "
               f"are {h.ratio_before:.3g} of what is calculated before, "
               f"{h.ratio_after:.3g} after")


def _with_parameter(one):
    """The name of an effect; of a wrong parameter, which it is."""
    wrong = one.values.get("parameter")
    return f"{one.name} {wrong[0]}" if wrong else one.name


def _is_other(d):
    """Where nothing is decided, is what was added not the first of the causes?"""
    first = next((c for c in d.causes if c.found), None)
    return bool(d.verdict == "undecided" and first) and sorted(first.names) != sorted(
        one.name for one in d.found)


def left(d):
    """What is left of the gap, in a sentence."""
    if d.found or d.verdict == "unknown":
        new = d.closure.closed + d.remainder.share > 1.0 + SLIGHT
        yield ("left" + ", with what stands out only now" * bool(new)
               + f": {percent(d.remainder.share)} of the gap; the chance of as much "
               f"is {chance(d.after.p_value)}")
    for r in d.final.readings:
        if r.opaque:
            hiding = ("so many clipped samples" if "limits" in r.found.values else
                      "counts about three times as coarse as the noise, or more,")
            yield (f"{hiding} hide the rest: other effects were not looked for, nor "
                   "was it judged whether what is left is one")
        elif r.coarse:
            yield ("counts are more than twice as coarse as the noise: beside them an "
                   "effect is named only if more speaks for it than in any of some "
                   "simulated records without it")
    if "unknown" in d.verdict:
        yield f"what is left fits no effect of the catalogue: {look_at(d)}"
        doubtful = [one.name for one, part in zip(d.found, d.parts) if not part.stays]
        if doubtful:
            yield (f"{', '.join(doubtful)} may stand in for it: not needed where it is "
                   "described by any colour and spread")


def sharper(nats):
    """A gain of the log-likelihood a sample, as one of normal prediction errors."""
    if not np.isfinite(nats):
        return "no better than can be told"
    share = 100.0 * -np.expm1(-nats)
    return f"{number(abs(share), 2)} % {'better' if share >= 0.0 else 'worse'}"


def closed_share(part):
    """How much of a gap closes, and its interval, as text."""
    if part.closed <= 0.0:
        return "nothing"
    low, high = part.interval
    return f"{percent(part.closed)} [{100 * low:.0f}, {100 * high:.0f}]"


def advice(d, unit):
    """What the effects are confused with, and which experiment tells."""
    rivals = [effect for c in d.causes[:2] for effect in c.effects]
    named = rivals if d.verdict == "undecided" else names_in(d.verdict)
    for e in (CATALOGUE[name] for name in dict.fromkeys(named) if name in CATALOGUE):
        yield (f"{e.name} is easily taken for {e.resembles}; to tell them apart: "
               f"{e.experiment}")
    for one in d.found:
        if one.variant in one.effect.alike and one.share < 0.5:
            continue    # another is as good
        if one.variant and one.effect.reading:
            yield f"{one.name} comes {one.variant} to counts"
        elif one.variant and not one.column:
            which = f" at {number(one.values['onset'][0])} s" if one.effect.begins and (
                [other.name for other in d.found].count(one.name) > 1) else ""
            yield (f"the form of {one.name}{which} is {one.variant}, probability "
                   f"{one.share:.2f}")
        elif one.variant:
            yield (f"{one.name} is that with the {one.variant} of {one.column}, "
                   f"probability {one.share:.2f} among its forms; its size is of that")
    for one in d.found:
        if one.low_pass and (one.effect.begins or one.low_pass.alters(
                d.scene.along(one.column), d.scene.dt)):
            yield (f"{one.name} is there before the low-pass, which smooths its edges: "
                   "behind it they would be sharp")
    for one in d.found:
        for p in one.effect.parameters(d.scene):
            mean, sd = one.values[p.symbol]
            if p.log and sd < WELL_KNOWN * mean and not p.low < mean - 2.0 * sd <= (
                    mean + 2.0 * sd) < p.high:
                end, more = (p.high, "more") if mean > np.sqrt(
                    p.low * p.high) else (p.low, "less")
                yield (f"{p.symbol} of {one.name} is at the end of what was tried, "
                       f"{number(end, 3)} {unit_of(p.symbol, unit)}".rstrip()
                       + f": it may be {more}")
    for r in d.final.readings:
        if r.moved:
            lsb = f"multiples of {number(r.found.values['lsb'], 3)} {unit}"
            neighbours = lattice_between(d.scene.y + d.scene.known)
            yield (f"neighbours are {lsb} apart, the record as a whole is not: "
                   "something was added to it after it was rounded" if neighbours else
                   f"the simulator rounds to {lsb}, the record does not: its own "
                   "counts are too fine to tell, or something was added to it after it "
                   "was rounded; how its values are rounded is not compared")
    for column in {s.found.column for s in d.final.signatures if s.found.column}:
        low, high = clusters(d.scene.columns[column])
        if high:
            yield (f"{column} is {low[0]:.4g} to {low[1]:.4g} or {high[0]:.4g} "
                   f"to {high[1]:.4g}, never between: whatever else changed "
                   "with it explains the record as well")
    alone, beside = d.bias
    if alone.is_large and (alone.taken or not beside.is_large):
        own = (f"{number(alone.mean, 3)} +- {number(alone.sd, 2)} {unit}, where the "
               f"simulator has a bias_sigma of {number(alone.sigma, 3)} {unit}")
        yield (f"the bias is {own}: it is taken as it is, and is no effect here"
               if alone.taken else
               f"without {added_names(d)} the bias would be {own}: if it may be that "
               "large, give it in the model file, and nothing else may be missing")
    if d.verdict == "undecided":
        yield (f"a record of about {float(f'{d.needed_duration:.2g}'):g} s would "
               "tell the first two apart, if the odds grow as they did")


WELL_KNOWN = 0.2    # of a parameter: less well known, it may be anywhere


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


# ---- all of it

def told(d, record, unit):
    """The diagnosis as sentences and tables, in order."""
    yield f"{record.heading}; beside it: {', '.join(record.columns) or 'nothing'}" + (
        f" (not used: {'; '.join(record.left_out)})" if record.left_out else "")
    wrong = [one.values["parameter"][0] for one in d.found
             if "parameter" in one.values and one.name in names_in(d.verdict)]
    yield f"verdict: {d.verdict}" + f" ({', '.join(wrong)})" * bool(wrong) + (
        ", alone or with another effect" if d.causes[0].probability < SURE
        and d.verdict != "undecided" else "")
    yield gap_sentence(d)
    yield from shown_by_both(d)
    yield causes_table(d, unit)
    yield places_table(d)
    yield from closing(d)
    yield from left(d)
    if d.drift and (d.found or d.verdict == "unknown"):
        yield "rms of the integrated error:"
        yield drift_table(d, unit)
    yield from advice(d, unit)


def table(d, record, unit, width=None):
    """The diagnosis as text, each row in one line if no width is given."""
    return as_text(*told(d, record, unit), width=width) + "\n"


def described(d, h, unit):
    """The error model of a record as a sum: a hypothesis and what was found."""
    own = {p.symbol: (p.mean, p.sd) for p in h.parameters}
    chance_of = present(d.causes)
    yield Table(("component", "share", "probability", "size"), (
        (h.name, "", "", values_text(own, unit)),
        *((one.name, percent(part.share), f"{chance_of.get(one.name, 0.0):.3f}",
           sizes([one], unit, d.scene.dt))
          for one, part in zip(d.found, d.parts))), (1, 2))
    if any(r.opaque for r in d.final.readings):
        yield from left(d)
    elif "unknown" not in d.verdict:
        yield ("their sum describes the record: the chance of a remainder as large is "
               f"{chance(d.remainder.p_value)}")
    else:
        yield (f"{percent(d.remainder.share)} of what white noise, walk and Markov "
               f"process leave is not described: {look_at(d)}")
