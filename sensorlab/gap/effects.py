"""What an effect is, as a catalogue, a simulator and an answer have it."""

import functools
from typing import Callable, NamedTuple

import numpy as np

from sensorid import Parameter, brief


class _Recorded(NamedTuple):
    y: np.ndarray    # (N,) sensor error, u; NaN where missing
    dt: float        # s
    columns: dict    # name -> (N,) array
    known: np.ndarray = 0.0    # (N,) or a number, u: what was taken away from the
                               # record, its offset and what the simulator adds
    rounding: float = 0.0      # u: standard deviation of what its digits leave out


class Scene(_Recorded):
    """A record and what was recorded beside it."""

    __repr__ = brief

    def cut(self, part):
        """A slice of the scene."""
        known = self.known[part] if np.ndim(self.known) else self.known
        return self._replace(y=self.y[part], known=known, columns={
            name: x[part] for name, x in self.columns.items()})

    @property
    def time(self):
        """Time since the first sample, s; not to be written to."""
        return _times(len(self.y), self.dt)

    def along(self, column):
        """A column (N,), or the time if it is ""."""
        return self.columns[column] if column else self.time

    @property
    def duration(self):
        return self.dt * len(self.y)

    @functools.cached_property    # every simulated record asks for it
    def white(self):
        """Standard deviation of the white part, from first differences; robust."""
        scale = np.median(self._steps) / 0.6745 or np.sqrt(np.mean(self._steps**2))
        return scale / np.sqrt(2.0)

    @functools.cached_property
    def contrast(self):
        """Ratio of the noisiest of many parts of the record to the quietest; robust."""
        count = max(len(self._steps) // PART, 1)
        scale = np.median(self._steps[:count * PART].reshape(count, -1), axis=1)
        scale = scale[scale > 0.0]
        return scale.max() / scale.min() if len(scale) else 1.0

    @functools.cached_property
    def leap(self):
        """Largest step from one sample to the next."""
        return self._steps.max(initial=0.0)

    @functools.cached_property
    def _steps(self):
        return np.abs(np.diff(self.y[~np.isnan(self.y)]))


PART = 64    # samples, which tell a variance to a sixth


@functools.lru_cache(maxsize=4)    # asked for thousands of times
def _times(samples, dt):
    time = dt * np.arange(samples)
    time.setflags(write=False)
    return time


class Jumps(NamedTuple):
    """Noise that is not Gaussian: outliers, and a level, of the value or of the noise,
    that is one of two.
    """

    rate: np.ndarray = 0.0        # probability that a sample is an outlier
    variance: np.ndarray = 0.0    # of an outlier, u^2
    begin: np.ndarray = 0.0       # probability that the second level begins, a sample
    end: np.ndarray = 0.0         # that it ends
    half: np.ndarray = 0.0        # half the distance of the two levels, u
    louder: np.ndarray = 0.0      # variance that the second adds to the noise, u^2
    step: np.ndarray = 0.0        # that it adds to the first state of the effects, u^2
    before: np.ndarray = 0.0      # 1 if what jumps is noise that passes a low-pass: a
                                  # step of it is there but once

    @property
    def share(self):
        """Of time that the second level has."""
        return self.begin / (self.begin + self.end)

    @property
    def sigma_w(self):
        """Of a random walk of the covariance that steps have, u."""
        return np.sqrt(self.begin * self.step)


def nothing(scene):
    """The parameters of an effect that has none but its size."""
    return ()


class Effect(NamedTuple):
    """An effect that a simulator may lack; a user's own is another of these.

    What it does is said by the field that is given: `columns`, `model`, `drive` (with a
    `model` that says the same), `jumps` (with a `model`, if it moves a state of its
    own), `reading` (with a `model`, if filters see some of it as noise) or `factor`.
    """

    name: str
    columns: Callable = None    # (scene, x, psi) -> pairs of a variant and an (N, k)
                                # array, k <= 2, which a size multiplies; x is the
                                # column beside the error, psi the parameter,
                                # or a tuple where there are several, for which it is
                                # searched as for a pulse or waves
    model: Callable = None      # (scene, filt, **parameters) -> ShapingFilter; it also
                                # takes the variant, where there are variants, and x,
                                # where it is relative to something
    variants: tuple = ()        # forms of a model, jumps, or a reading; "" is the first
    of_all: tuple = ()          # pairs of one that acts on all processes, found before
                                # or since, and of the same on the white noise alone
    alike: tuple = ()           # forms that are one a priori, as they are the same of
                                # white noise
    before: tuple = ()          # forms of jumps that pass a low-pass that all passes,
                                # and differ from others only where there is one
    elementwise: bool = False   # the model takes columns (M, 1) of M nodes, too
    comes_last: bool = False    # the model alters what all others make, as that of a
                                # reading does; a reading, what others have read
    on_average: Callable = None    # the model with white noise of the mean variance,
                                # where it makes some that changes
    drive: Callable = None      # as the model, but for the filter -> how many times as
                                # strong (..., N) what drives some states is; the model
                                # says the same
    of_white: bool = False      # these are the states of low-passed white noise; the
                                # hypothesis's own, if not
    jumps: Callable = None      # (dt, **parameters) -> Jumps; also takes the variant,
                                # where there are variants
    reading: Callable = None    # (scene, y, **values) alters values y (..., N) in place
    factor: float = 0.0         # by which a parameter of the simulator may be wrong, or
                                # all standard deviations
    parameters: Callable = nothing    # of the scene: priors of all that is no size
    relative_to: Callable = None    # (x, variant) -> numbers by name that a model also
                                # takes; x is the column beside the error, or the time
    search: str = ""            # how psi is found: "onset", "frequency", "waves" (in
                                # an envelope, which they are at frequency 0), "pulse"
                                # (its variants are among `onsets.SHAPES`), else by a
                                # list; a model that shows in the spectrum of the
                                # residuals: "spectrum", or "band" by its frequency
    becomes: str | tuple = ""   # the simpler effect, or effects, that it is at an end
                                # of its parameters, beside the same column
    size: str = "size"          # what the factor of the columns is called
    column: str | tuple = ""    # what must be recorded beside the error; "*" is what no
                                # other effect names, "any" is anything; a tuple is one
                                # of several
    also: str = ""              # a column that must be there, too
    equation: str = ""          # what becomes of the error y, with units
    resembles: str = ""         # what it is confused with
    experiment: str = ""        # what tells them apart

    @property
    def begins(self):
        """Do its columns begin at some time?"""
        return bool(self.columns) and self.search in ("onset", "pulse", "waves")

    @property
    def has_edges(self):
        """Do its columns begin at some time, or follow one that may change at once?"""
        return self.begins or bool(self.columns and self.column)

    @property
    def named(self):
        """Names of the columns, one of which must be recorded beside the error."""
        return np.atleast_1d(self.column).tolist()

    def takes(self, column, others):
        """Is it looked for beside a column, of whose names `others` name some?"""
        return (column in self.named or "any" in self.named
                or "*" in self.named and column not in others)

    @property
    def may_repeat(self):
        """May a simulator have several?"""
        return bool(self.columns) or self.search == "band"

    def __repr__(self):
        return f"Effect({self.name!r})"


class Found(NamedTuple):
    """An effect as a simulator has it, or as a record shows it."""

    effect: Effect
    column: str = ""     # of the record, "" where none is needed
    variant: str = ""    # of the columns, "" where there is one only
    values: dict = {}    # symbol -> Parameter or number in a simulator, a size and a
                         # phase among them; (mean, sd) in an answer
    share: float = 1.0   # probability of the variant among all, in an answer
    number: int = 1      # inside a filter, where there are several of one effect
    low_pass: object = None    # `LowPass` that its columns pass, if there is one

    @property
    def name(self):
        return self.effect.name

    @property
    def needs(self):
        """Names of the columns that it needs beside the error."""
        return [name for name in (self.column, self.effect.also) if name]

    @property
    def key(self):
        """Its name among the effects inside a filter."""
        return self.name if self.number == 1 else f"{self.name}_{self.number}"

    @property
    def acts_on_all(self):
        """Is it in a form that acts on all processes?"""
        return self.variant in dict(self.effect.of_all)


LONG_RECORD = 20000    # samples from which on fewer draws must do
BLOCK = 10**6    # samples of simulated records that are worked on at a time: 100 MB


def fixed(**values):
    """Values of an effect as parameters that are known."""
    return {symbol: Parameter(symbol, float(v), float(v))
            for symbol, v in values.items()}


def known_values(one):
    """Values of an effect of a simulator that has no ranges."""
    return {symbol: getattr(p, "low", p) for symbol, p in one.values.items()}


def signature_of(scene, one, value):
    """What an effect with columns adds (N,) at values of its parameters."""
    columns = columns_of(scene, one, value)
    size = np.array([value[one.effect.size]])
    if columns.shape[1] == 2:
        phase = value.get("phase", 0.0)
        size = size * [np.cos(phase), -np.sin(phase)]
    return np.einsum("nk, k -> n", columns, size)    # no threads that spin


def psi_of(scene, effect, values):
    """What the columns of an effect depend on: NaN, a number or several."""
    psi = tuple(values[p.symbol] for p in effect.parameters(scene))
    return psi if len(psi) > 1 else psi[0] if psi else np.nan


def columns_of(scene, one, values):
    """The columns (N, k) of an effect, as `Found`, at values of its parameters; of its
    variants "" is the first.
    """
    built = one.effect.columns(scene, scene.columns.get(one.column), psi_of(
        scene, one.effect, values))
    columns = next(c for name, c in built if one.variant in ("", name))
    return one.low_pass.passed(columns, scene.dt) if one.low_pass else columns


def describe(effect, scene=None):
    """Definition of an effect as text: equation, columns, what it is confused with and
    how to tell; with a scene, the priors that it has there.
    """
    lines = [f"{effect.name}: {effect.equation}"]
    if effect.column:
        lines.append("needs, as x, " + " or ".join(
            {"*": "any other column", "any": "any column"}.get(name, f"a column {name}")
            for name in effect.named)
            + (f"; and a column {effect.also}" if effect.also else ""))
    if scene:
        units = dict(onset="s", tau="s", dwell="s", quiet="s", duration="s",
                     frequency="Hz", sigma="u", size="u")
        lines += [f"{p.symbol}: {'log-' if p.log else ''}uniform from {p.low:.4g} to "
                  f"{p.high:.4g} {units.get(p.symbol, '')}".rstrip()
                  for p in effect.parameters(scene)]
    lines.append(f"confused with: {effect.resembles}")
    lines.append(f"to tell: {effect.experiment}")
    return "\n    ".join(lines)
