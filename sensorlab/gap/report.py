"""A diagnosis as JSON, for programs."""

import numpy as np

from sensorlab.gap.verdict import present
from sensorlab.gap.words import outstanding


def finite(x):
    """A value for JSON: None for a number that there is not."""
    if isinstance(x, dict):
        return {name: finite(v) for name, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [finite(v) for v in x]
    if x is None or isinstance(x, (str, int)):
        return x
    return float(x) if np.isfinite(x) else None


def check_recording(record):
    """Refuse what is no `Recording`, as `read` gives one."""
    if not hasattr(record, "file"):
        raise ValueError(f"a {type(record).__name__} stands where a Recording, as read "
                         "gives one, is needed")


def report(d, record):
    """Contents of report.json for a diagnosis of a `Record`."""
    check_recording(record)
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
        bias=dict(mean=d.bias[1].mean, sd=d.bias[1].sd, bias_sigma=d.bias[1].sigma),
        found=[dict(effect=one.name, column=one.column or None,
                    variant=one.variant or None,
                    low_pass=one.low_pass and one.low_pass._asdict(),
                    share=part.share, needed=part.stays,
                    probability=present(d.causes).get(one.name, 0.0),
                    parameters=_parameters(one.values))
               for one, part in zip(d.found, d.parts)],
        shared=[one.name for one in d.shared],
        where=[dict(**_place(s, i), before=abs(float(d.before.distance[i])),
                    after=abs(float(d.after.distance[i])),
                    p_value=d.before.p_place[s.place[i]],
                    residual_p_value=d.after.p_place[s.place[i]])
               for i in outstanding(d.before)],
        causes=[dict(effect=c.effect, column=c.column or None,
                     variant="+".join(one.variant for one in c.found if one.variant)
                     or None,
                     probability=c.probability, probability_error=c.error,
                     log_bayes_factor=c.log_bayes,
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
