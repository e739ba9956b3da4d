"""A record, the effects that a simulator may lack, simulated records that have them."""

from typing import Callable, NamedTuple

import numpy as np
from scipy.signal import lfilter

from sensorid import Parameter, ShapingFilter, simulate


class Scene(NamedTuple):
    """A record and what was recorded beside it."""

    y: np.ndarray    # (N,) sensor error, u; NaN where missing
    dt: float        # s
    columns: dict    # name -> (N,) array

    @property
    def time(self):
        """Time since the first sample, s."""
        return self.dt * np.arange(len(self.y))

    @property
    def duration(self):
        return self.dt * len(self.y)

    @property
    def white(self):
        """Standard deviation of the white part, from first differences; robust."""
        step = np.abs(np.diff(self.y[~np.isnan(self.y)]))
        scale = np.median(step) / 0.6745 or np.sqrt(np.mean(step**2))
        return scale / np.sqrt(2.0)


class Effect(NamedTuple):
    """An effect that a simulator may lack; a user's own is another of these."""

    name: str
    kind: str               # "signature", "process", "jumps" or "reading"
    parameters: Callable    # of the scene: priors of what is not a size
    build: Callable         # see `CATALOGUE`
    size: str = ""          # what the coefficient of a signature is called
    column: str = ""        # what must be recorded beside the error
    resembles: str = ""     # what it is confused with
    experiment: str = ""    # what tells them apart
    equation: str = ""      # what becomes of the error y, with units


def _none(scene):
    return ()


def _centred(x):
    """Less its mean; 0 where nothing but rounding varies."""
    return (x - x.mean()) * (np.ptp(x) > 1e-9 * np.abs(x).max())


def _from_start(scene, column, psi):
    yield "", scene.time[:, None]


def _step(scene, column, psi):
    yield "", (scene.time >= psi - 1e-9 * scene.dt)[:, None].astype(float)


def _transient(scene, column, psi):
    yield "", np.exp(-scene.time / psi)[:, None]


def _sinusoid(scene, column, psi):
    phase = 2.0 * np.pi * psi * scene.time
    yield "", np.column_stack([np.cos(phase), np.sin(phase)])


def _linear(scene, column, psi):
    yield "", _centred(column)[:, None]


def _curved(scene, column, psi):
    yield "square", _centred(column**2)[:, None]
    yield "modulus", _centred(np.abs(column))[:, None]


def _derivative(scene, column, psi):
    step = np.diff(column) / scene.dt
    yield "backward", np.append(0.0, step)[:, None]
    yield "forward", np.append(step, 0.0)[:, None]
    yield "central", np.gradient(column, scene.dt)[:, None]


def lagged(x, dt, tau):
    """First-order low-pass of time constant tau, s, in steady state at the start."""
    a = np.exp(-dt / tau)
    return lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0]


def _lagged(scene, column, psi):
    yield "", _centred(lagged(column, scene.dt, psi))[:, None]


def _beside(filt, a, sigma):
    """A shaping filter with Markov processes of factors a, standard deviations sigma
    added to its output.
    """
    n, m, k = filt.Phi.shape[1], filt.Gamma.shape[2], len(a)
    Phi, Gamma, P0 = (np.zeros((n + k, n + k)), np.zeros((n + k, m + k)),
                      np.zeros((n + k, n + k)))
    Phi[:n, :n], Gamma[:n, :m], P0[:n, :n] = filt.Phi[0], filt.Gamma[0], filt.P0
    for i in range(k):
        Phi[n + i, n + i] = a[i]
        Gamma[n + i, m + i] = sigma[i] * np.sqrt(1.0 - a[i]**2)
        P0[n + i, n + i] = sigma[i]**2
    return ShapingFilter(Phi[None], Gamma[None],
                         np.append(filt.H[0], np.ones(k))[None], filt.Psi,
                         np.append(filt.m0, np.zeros(k)), P0)


def _correlated_noise(scene, h):
    def extended(dt, tau, sigma, **base):
        return _beside(h.model(dt, **base), [np.exp(-dt / tau)], [sigma])
    return extended


def flicker_times(scene):
    """Correlation times, s, of the processes that make up flicker noise: from a tenth
    of the record to the sampling interval, at even distances, five at most.
    """
    decades = max(np.log10(0.1 * scene.duration / scene.dt), 0.0)
    return 0.1 * scene.duration * 10.0**-np.linspace(
        0.0, decades, int(np.clip(2.0 * decades, 1, 5)))


def _bias_instability(scene, h):
    """Flicker noise, as strong as one Markov process a decade from a tenth of the
    record downwards would be with the standard deviation sigma all together.

    The coefficient B of IEEE Std 952 (two-sided S = B^2 / (2 pi f)) is sigma times
    sqrt(pi / (decades ln 10)).
    """
    taus = flicker_times(scene)
    decades = np.floor(max(np.log10(0.1 * scene.duration / scene.dt), 0.0)) + 1.0
    apart = np.log10(taus[0] / taus[1]) if len(taus) > 1 else 1.0
    a, part = np.exp(-scene.dt / taus), np.full(len(taus), np.sqrt(apart / decades))

    def extended(dt, sigma, **base):
        return _beside(h.model(dt, **base), a, sigma * part)
    return extended


def _bandwidth(scene, h):
    """The white noise passes a first-order low-pass of unit gain at rest."""
    def extended(dt, tau, **base):
        filt = h.model(dt, **base)
        a = np.exp(-dt / tau)
        low = np.sqrt((1.0 - a) / (1.0 + a)) * filt.Psi
        return _beside(filt._replace(Psi=np.zeros(1)), [a], low)
    return extended


def _noise_step(scene, h):
    time = scene.time

    def extended(dt, onset, ratio, **base):
        filt, first = h.model(dt, **base), np.searchsorted(time, onset)
        if first == len(time):
            return filt
        Psi = filt.Psi * np.ones(len(time))
        Psi[first:] *= ratio
        return filt._replace(Psi=Psi)
    return extended


def _quantize(scene, y, value):
    seen = scene.y[~np.isnan(scene.y)]
    origin = seen[0] if len(seen) and lattice(scene.y) else 0.0
    y[:] = origin + value["lsb"] * np.round((y - origin) / value["lsb"])


def _saturate(scene, y, value):
    np.clip(y, *value["limits"], out=y)


def _stick(scene, y, value):
    for start, length in value["spans"]:
        first = round(start / scene.dt)
        y[..., first:first + int(length)] = y[..., first:first + 1]


def lattice(y):
    """Spacing of the values of a record, or 0 where they lie on no lattice."""
    values = np.unique(y[~np.isnan(y)])
    if len(values) < 2:
        return 0.0
    step = np.diff(values)
    step = step[step > 1e-9 * (values[-1] - values[0])]
    lsb = step.min()
    for _ in range(3):    # refine with ever larger multiples
        lsb = np.sum(step) / np.sum(np.round(step / lsb))
    off = np.abs(step / lsb - np.round(step / lsb))
    return float(lsb) if np.mean(off < 0.05) > 0.95 else 0.0


def _log(symbol, low, high):
    return Parameter(symbol, low, max(high, 1.01 * low), True)


def _spread(scene):
    return max(np.nanstd(scene.y), 3.0 * scene.white)


CYCLES = 3    # in a record, of a sinusoid at least: slow noise shows fewer by itself
              # (S. Krishnan et al., Mon. Not. R. Astron. Soc. 508, 2021)


CATALOGUE = {effect.name: effect for effect in (
    Effect("rate_ramp", "signature", _none, _from_start, "slope",
           equation="y + slope t; slope in u/s",
           resembles="random walk, slow transient",
           experiment="record longer"),
    Effect("bias_step", "signature",
           lambda s: (Parameter("onset", s.dt, s.duration - s.dt),), _step, "size",
           equation="y + size from t = onset on; onset in s, size in u",
           resembles="random walk, one stuck interval",
           experiment="look for what happened at the onset: a knock, a restart"),
    Effect("turn_on_transient", "signature",
           lambda s: (_log("tau", s.duration / 400, s.duration / 3),), _transient,
           "size",
           equation="y + size exp(-t / tau); tau in s, size in u",
           resembles="rate ramp, temperature",
           experiment="switch off, cool down and on again: it returns"),
    Effect("sinusoid", "signature",
           lambda s: (Parameter("frequency", CYCLES / s.duration, 0.5 / s.dt),),
           _sinusoid, "amplitude",
           equation="y + amplitude sin(2 pi frequency t + phase); frequency in Hz, "
                    "amplitude in u",
           resembles="correlated noise of long period",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("temperature", "signature", _none, _linear, "coefficient", "temperature",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="random walk, thermal lag",
           experiment="cycle the temperature twice at different speed"),
    Effect("thermal_lag", "signature",
           lambda s: (_log("tau", s.duration / 100, s.duration / 4),), _lagged,
           "coefficient", "temperature",
           equation="y + coefficient (X - mean of X), tau dX/dt = x - X; tau in s, "
                    "coefficient in u per unit of x",
           resembles="temperature",
           experiment="step the temperature and hold it"),
    Effect("scale_factor", "signature", _none, _linear, "coefficient", "rate",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="nonlinearity",
           experiment="turn at several known rates of both signs"),
    Effect("nonlinearity", "signature", _none, _curved, "coefficient", "rate",
           equation="y + coefficient f, f = x^2 or |x| less its mean; in u per unit "
                    "of f",
           resembles="scale factor where the rate has one sign",
           experiment="turn at several known rates of both signs"),
    Effect("latency", "signature", _none, _derivative, "coefficient", "rate",
           equation="y + coefficient dx/dt; in u per unit of x and second",
           resembles="scale factor under slow motion",
           experiment="turn with sharp starts and stops"),
    Effect("g_sensitivity", "signature", _none, _linear, "coefficient",
           "acceleration",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="scale factor",
           experiment="turn the sensor over at rest"),
    Effect("covariate", "signature", _none, _linear, "coefficient", "*",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="any drift that moves as the column does",
           experiment="vary that quantity alone"),
    Effect("correlated_noise", "process",
           lambda s: (_log("tau", 1.5 * s.dt, s.duration / 10),
                      _log("sigma", 0.03 * s.white, _spread(s))), _correlated_noise,
           equation="y + m, dm/dt = -m / tau + white noise, standard deviation of m "
                    "sigma; tau in s, sigma in u",
           resembles="bias instability, random telegraph, random walk",
           experiment="record longer, sample faster"),
    Effect("bias_instability", "process",
           lambda s: (_log("sigma", 0.01 * s.white, _spread(s)),), _bias_instability,
           equation="y + Markov processes, tau evenly in log from dt to T / 10, "
                    "together of standard deviation sigma, in u",
           resembles="correlated noise, random walk", experiment="record longer"),
    Effect("bandwidth", "process",
           lambda s: (_log("tau", 0.15 * s.dt, 50.0 * s.dt),), _bandwidth,
           equation="the white noise v becomes V, tau dV/dt = v - V; tau in s",
           resembles="correlated noise of short time", experiment="sample faster"),
    Effect("noise_step", "process",
           lambda s: (Parameter("onset", s.dt, s.duration - s.dt),
                      _log("ratio", 0.1, 10.0)), _noise_step,
           equation="the white noise becomes ratio times as strong from t = onset "
                    "on; onset in s",
           resembles="outliers in clusters",
           experiment="look for what was switched on at the onset"),
    Effect("outliers", "jumps",
           lambda s: (_log("rate", 1.0 / len(s.y), 0.1),
                      _log("sigma", 2.0 * s.white, 300.0 * s.white)), None,
           equation="y + N(0, sigma^2) with the probability rate in every sample; "
                    "sigma in u",
           resembles="noise step, random telegraph",
           experiment="log the raw bus: are they transmission errors?"),
    Effect("random_telegraph", "jumps",
           lambda s: (_log("dwell", 3.0 * s.dt, s.duration / 4),
                      _log("size", 0.1 * s.white, 2.0 * _spread(s))), None,
           equation="y +- size / 2, two levels, each kept for dwell on average; "
                    "dwell in s, size in u",
           resembles="correlated noise",
           experiment="average less white noise away: two levels show in a histogram"),
    Effect("quantization", "reading", _none, _quantize,
           equation="lsb round(y / lsb); lsb in u",
           resembles="white noise",
           experiment="widen the word length, raise the gain"),
    Effect("saturation", "reading", _none, _saturate,
           equation="y between two limits, in u",
           resembles="skewed noise",
           experiment="widen the range"),
    Effect("stuck", "reading", _none, _stick,
           equation="y keeps its value in spans of (start in s, samples)",
           resembles="quantization",
           experiment="compare the counters of sensor and logger"),
    Effect("wrong_parameter", "parameter", _none, None,
           equation="one parameter of the simulator is factor times what it says",
           resembles="correlated noise, bandwidth",
           experiment="compare the Allan deviation with the data sheet, unit by unit"),
)}


def describe(effect, scene=None):
    """Definition of an effect as text: equation, columns, what it is confused with and
    how to tell; with a scene, the priors that it has there.
    """
    lines = [f"{effect.name}: {effect.equation}"]
    if effect.column:
        lines.append("needs, as x, " + ("any other column" if effect.column == "*" else
                                        f"a column {effect.column}"))
    if scene:
        units = dict(onset="s", tau="s", dwell="s", frequency="Hz", sigma="u", size="u")
        lines += [f"{p.symbol}: {'log-' if p.log else ''}uniform from {p.low:.4g} to "
                  f"{p.high:.4g} {units.get(p.symbol, '')}".rstrip()
                  for p in effect.parameters(scene)]
    lines.append(f"confused with: {effect.resembles}")
    lines.append(f"to tell: {effect.experiment}")
    return "\n    ".join(lines)


def extend(scene, h, effect):
    """Hypothesis with a process or jumps as well, and their parameters."""
    extra = tuple(p._replace(symbol=f"{effect.name}.{p.symbol}")
                  for p in effect.parameters(scene))
    inner = effect.build(scene, h) if effect.kind == "process" else (
        lambda dt, **values: h.model(dt, **values))

    def model(dt, **values):
        own = {p.symbol.split(".")[1]: values.pop(p.symbol) for p in extra}
        return inner(dt, **values, **(own if effect.kind == "process" else {}))
    model.plain = getattr(h.model, "plain", h)
    model.effects = {**getattr(h.model, "effects", {}), effect.name: effect}
    return h._replace(model=model, parameters=h.parameters + extra)


BLOCK = 10**6    # samples of simulated records that are worked on at a time: 100 MB


class Added(NamedTuple):
    """An effect as a simulator has it."""

    effect: Effect
    column: str          # of the record, "" where none is needed
    variant: str         # of a signature, "" where there is one only
    parameters: dict     # symbol -> Parameter; a size, and a phase, among them


def simulate_effects(hypotheses, effects, scene, trials=1, seed=0, first=0):
    """Records of hypotheses with effects.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        Equally probable.
    effects : sequence of sequences of Added
        Those of every hypothesis.
    scene : Scene
        Gives the length and the columns; its missing samples will be missing.
    trials, seed, first : int
        As for `simulate`.

    Returns
    -------
    Trials
        As `simulate` draws them, then altered. Processes and jumps are added to the
        noise, signatures to the sum, readings last.
    """
    extended = [with_processes(scene, h, added)
                for h, added in zip(hypotheses, effects)]
    drawn = simulate(extended, scene.dt, len(scene.y), trials, seed, first)
    for trial, y in enumerate(drawn.error):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + trial, 1)))
        h = extended[drawn.hypothesis[trial]]
        values = dict(zip((p.symbol for p in h.parameters), drawn.theta[trial]))
        _add_jumps(y, scene.dt, values, rng)
        for one in effects[drawn.hypothesis[trial]]:
            if one.effect.kind == "signature":
                y += signature_of(scene, one, {
                    symbol: p.quantile(rng.random()) if isinstance(p, Parameter) else p
                    for symbol, p in one.parameters.items()})
    for number, added in enumerate(effects):
        own = drawn.hypothesis == number
        read = drawn.error[own]
        for one in added:
            if one.effect.kind == "reading":
                one.effect.build(scene, read, one.parameters)
        drawn.error[own] = read
    drawn.error[:, np.isnan(scene.y)] = np.nan
    return drawn


def with_processes(scene, h, added):
    """Hypothesis with the processes and jumps among added effects."""
    for one in added:
        if one.effect.kind in ("process", "jumps"):
            h = extend(scene, h, one.effect)
            h = h._replace(parameters=tuple(
                one.parameters[p.symbol.partition(".")[2]]._replace(symbol=p.symbol)
                if p.symbol.startswith(one.effect.name + ".") else p
                for p in h.parameters))
    return h


def signature_of(scene, one, value):
    """The signature (N,) of an added effect at values of its parameters."""
    e = one.effect
    psi = next((value[p.symbol] for p in e.parameters(scene)), np.nan)
    built = e.build(scene, scene.columns.get(one.column), psi)
    columns = next(c for variant, c in built if one.variant in ("", variant))
    size = np.array([value[e.size]])
    if columns.shape[1] == 2:
        phase = value.get("phase", 0.0)
        size = size * [np.cos(phase), -np.sin(phase)]
    return columns @ size


def _add_jumps(y, dt, value, rng):
    """Outliers and telegraph noise, by the names of their parameters, added to y."""
    N = len(y)
    if "outliers.rate" in value:
        at = rng.random(N) < value["outliers.rate"]
        y[at] += value["outliers.sigma"] * rng.standard_normal(at.sum())
    if "random_telegraph.size" in value:
        change = rng.random(N) < -0.5 * np.expm1(
            -2.0 * dt / value["random_telegraph.dwell"])
        level = (rng.integers(2) + np.cumsum(change)) % 2
        y += value["random_telegraph.size"] * (level - 0.5)
