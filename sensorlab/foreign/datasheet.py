"""A data sheet as a model file: {"datasheet": {...}, "unit": "deg/s", "dt": 0.01}.

    noise_density      one-sided, as spectrum analysers show it: 0.05 deg/s/sqrt(Hz).
                       sigma_v = density sqrt(rate / 2): what lies above half the rate
                       is filtered away before the sensor samples
    random_walk        by its unit: deg/sqrt(h), m/s/sqrt(h) is that of angle or
                       velocity, sigma_v = N / sqrt(dt), in place of the density;
                       deg/h/sqrt(h), mg/sqrt(h) that of the rate or acceleration,
                       sigma_w = K sqrt(dt)
    rate_random_walk   the latter, where both are given
    bias_instability   the lowest Allan deviation, 0.664 B of IEEE Std 952, as flicker
                       noise; in records of `duration`, an hour unless said otherwise
    bandwidth          -3 dB, of a first-order low-pass of the white noise, Hz
    resolution, range  value of a bit; +- the largest value
    bias               standard deviation from one switch-on to the next, 0 if not given
    rate               or sampling_interval, in place of dt

Units convert to `unit`. `dt`, `rate` or `sampling_interval` is needed.
"""

import numpy as np

from sensorid import as_number
from sensorlab.foreign.parts import interval
from sensorlab.units import (
    alike, factor, flicker_sigma, kind_of, low_pass_time, white_from_density)

KEYS = ("noise_density", "random_walk", "rate_random_walk", "bias_instability",
        "bandwidth", "resolution", "range", "bias", "rate", "sampling_interval",
        "duration")
WHITE = "noise_density", "random_walk"    # that may say the white noise: one must


def model(raw, dt=None):
    """Text of a model file from that of a data sheet."""
    sheet, unit = raw["datasheet"], raw.get("unit")
    if not isinstance(sheet, dict):
        raise ValueError("datasheet must be an object of texts such as "
                         "\"noise_density\": \"0.05 deg/s/sqrt(Hz)\"")
    strange = [key for key in sheet if key not in KEYS]
    strange += [key for key in raw if key not in ("datasheet", "unit", "dt", "$schema")]
    if strange:
        raise ValueError(f"a data sheet has no key {strange[0]}; it has "
                         f"{', '.join(KEYS)}, and beside it unit and dt")
    if not isinstance(unit, str):
        raise ValueError("a data sheet needs the \"unit\" of the record, such as deg/s")
    kind_of(unit)
    dt = interval(_said(raw, sheet) if dt is None else dt)

    def value(key, per=""):
        return _value(sheet, key, f"({unit}){per}")
    sigma_v, sigma_w = _white_and_walk(sheet, unit, dt)
    effects = []
    if "bias_instability" in sheet:
        duration = _value(sheet, "duration", "s") if "duration" in sheet else 3600.0
        effects.append(_effect("bias_instability", sigma=flicker_sigma(
            value("bias_instability"), dt, duration)))
    if "bandwidth" in sheet:
        effects.append(_effect("bandwidth",
                               tau=low_pass_time(_value(sheet, "bandwidth", "Hz"))))
    if "range" in sheet:
        effects.append(_effect("saturation", limits=[-value("range"), value("range")]))
    if "resolution" in sheet:
        effects.append(_effect("quantization", lsb=value("resolution")))
    parameters = dict(sigma_v=sigma_v) | (dict(sigma_w=sigma_w) if sigma_w else {})
    return dict(dt=dt, unit=unit, bias_sigma=value("bias") if "bias" in sheet else 0.0,
                hypotheses=[dict(name="random_walk" if sigma_w else "white_noise",
                                 parameters=parameters, effects=effects)])


def _effect(name, **parameters):
    return dict(name=name, parameters=parameters)


def _said(raw, sheet):
    """Sampling interval, s, from whichever key says it; None if none does."""
    said = [1.0 / _value(sheet, "rate", "Hz") if "rate" in sheet else None,
            _value(sheet, "sampling_interval", "s")
            if "sampling_interval" in sheet else None,
            as_number(raw["dt"], "dt") if "dt" in raw else None]
    said = [dt for dt in said if dt is not None]
    if len(said) > 1 and max(said) > 1.001 * min(said):
        raise ValueError("dt, rate and sampling_interval disagree: "
                         + ", ".join(f"{dt:g} s" for dt in said))
    return said[0] if said else None


def _white_and_walk(sheet, unit, dt):
    """sigma_v and sigma_w, per sample."""
    density, angle, rate = f"({unit})/Hz**0.5", f"({unit})*s**0.5", f"({unit})/s**0.5"
    white, walk = [], 0.0
    if "noise_density" in sheet:
        white.append(white_from_density(_value(sheet, "noise_density", density),
                                        1.0 / dt))
    for key in ("random_walk", "rate_random_walk"):
        if key in sheet:
            if key == "random_walk" and alike(sheet[key], angle):
                white.append(_value(sheet, key, angle) / np.sqrt(dt))
            else:
                walk = np.hypot(walk, _value(sheet, key, rate) * np.sqrt(dt))
    if len(white) != 1:
        raise ValueError("a data sheet needs the white noise once: noise_density, or "
                         f"random_walk in units such as deg/sqrt(h); here it is given "
                         f"{len(white)} times")
    return white[0], walk


def _value(sheet, key, unit):
    """A positive number in a unit."""
    try:
        found = factor(sheet[key], unit)
    except ValueError as problem:
        raise ValueError(f"{key}: {problem}") from None
    if not found > 0.0:
        raise ValueError(f"{key} is {sheet[key]}: it must be > 0")
    return found
