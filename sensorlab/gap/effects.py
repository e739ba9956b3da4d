"""What an effect is; a simulator with effects, and the records that it draws."""

import functools
from typing import Callable, NamedTuple

import numpy as np

from sensorid import Hypothesis, Parameter, brief, simulate


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
        step = np.abs(np.diff(self.y[~np.isnan(self.y)]))
        scale = np.median(step) / 0.6745 or np.sqrt(np.mean(step**2))
        return scale / np.sqrt(2.0)


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
                                # or a tuple where there are several
    model: Callable = None      # (scene, filt, **parameters) -> ShapingFilter; it also
                                # takes the variant, where there are variants, and x,
                                # where it is relative to something
    variants: tuple = ()        # forms of a model; "" is the first
    of_all: tuple = ()          # pairs of one that acts on all processes, found before
                                # or since, and of the same on the white noise alone
    alike: tuple = ()           # forms that are one a priori, as they are the same of
                                # white noise
    uneven: tuple = ()          # pairs of a form and of that which stands in for it
                                # where a noise changes
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
    jumps: Callable = None      # (dt, **parameters) -> Jumps
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


class Simulator(NamedTuple):
    """Hypotheses, equally probable, and the effects of each."""

    hypotheses: tuple     # of Hypothesis
    effects: tuple = ()   # of every hypothesis a tuple of Found; () if none has any
    joint: object = None  # `Joint` of the parameters, where a record tells them

    @property
    def pairs(self):
        """(hypothesis, its effects) of all."""
        return tuple(zip(self.hypotheses, self.effects or ((),) * len(self.hypotheses)))


class Member(NamedTuple):
    """A hypothesis with the effects that are inside its filter: models and jumps.

    It goes wherever a `Hypothesis` goes. Its parameters are those of the hypothesis,
    then those of every effect.
    """

    hypothesis: Hypothesis
    scene: Scene
    effects: tuple = ()    # of Found
    joint: object = None   # as of a `Simulator`

    __repr__ = brief

    @property
    def name(self):
        return self.hypothesis.name

    @property
    def bias_sigma(self):
        return self.hypothesis.bias_sigma

    @property
    def parameters(self):
        return (*self.hypothesis.parameters,
                *(p for one in self.effects for p in one.values.values()))

    @property
    def keys(self):
        """(effect, symbol) of every parameter; "" is no effect."""
        return [*(("", p.symbol) for p in self.hypothesis.parameters), *(
            (one.key, symbol) for one in self.effects for symbol in one.values)]

    def value(self, theta, effect, symbol):
        """A parameter by name from theta (..., p)."""
        return theta[..., self.keys.index((effect, symbol))]

    def of(self, one, theta):
        """Parameters of one of the effects by symbol from theta (..., p)."""
        return {symbol: self.value(theta, one.key, symbol) for symbol in one.values}

    def log_joint(self, theta):
        """What the simulator's own record tells of theta (M, p): a share of its
        log-likelihood (M,), or 0.
        """
        return self.joint.at(self, theta) if self.joint else 0.0

    def in_units(self, theta):
        """Theta (..., p) with all standard deviations times their common factor, if it
        is one of the effects: those of the hypothesis and of the effects before it.
        """
        for number, one in enumerate(self.effects):
            if one.effect.factor:
                before = self._replace(effects=self.effects[:number]).keys
                scaled = [c for c, (_, symbol) in enumerate(before)
                          if symbol.startswith("sigma")]
                factor = self.value(theta, one.key, "factor")
                theta = theta.copy()
                theta[..., scaled] *= np.asarray(factor)[..., None]
        return theta

    def filter(self, dt, theta):
        """Shaping filter at one value of the parameters, or at all nodes (p, M, 1).

        What digits were rounded by is white, whatever all else has passed: it is most
        of what a low-pass leaves at half the sampling rate.
        """
        filt, rounding = self._stages(dt, theta)[-1], self.scene.rounding
        return filt._replace(Psi=np.hypot(filt.Psi, rounding)) if rounding else filt

    def _stages(self, dt, theta):
        """The filter of the hypothesis, then that with one more effect at a time."""
        theta = iter(self.in_units(np.transpose(theta)).T)
        filt = self.hypothesis.filter(dt, [next(theta) for _ in
                                           self.hypothesis.parameters])
        values = {one.key: {symbol: next(theta) for symbol in one.values}
                  for one in self.effects}
        stages = [filt]
        for one in self.in_turn:
            if one.effect.model:
                filt = one.effect.model(self.scene, filt, **self._form(one),
                                        **values[one.key])
                stages.append(filt)
        return stages

    def _form(self, one):
        """What a model takes beside the parameters of an effect."""
        return dict(**dict(variant=one.variant) if one.effect.variants else {},
                    **dict(x=self.scene.along(one.column)) if one.effect.relative_to
                    else {})

    def strength(self, one, theta):
        """How many times as strong (M, N) an effect makes a noise at theta (M, p)."""
        return one.effect.drive(self.scene, **self._form(one), **{
            symbol: value[:, None] for symbol, value in self.of(one, theta).items()})

    @property
    def in_turn(self):
        """Its effects in the order in which they act: what drives states comes first,
        then the state that jumps move; a low-pass that all passes after all processes;
        what alters the values after all that makes them: it does not smooth rounding.
        """
        return sorted(self.effects, key=lambda one: (
            not one.effect.drive, not one.effect.jumps,
            one.effect.comes_last or bool(one.effect.reading),
            one.acts_on_all))

    @property
    def at_mean(self):
        """The filters that it is made of one after another, at mean parameters."""
        theta = np.array([p.mean for p in self.parameters])
        return self._stages(self.scene.dt, theta)

    @property
    def order(self):
        """How many states its processes have, of each two at most: those of flicker
        have one parameter.
        """
        states = [len(filt.m0) for filt in self.at_mean]
        return states[0] + int(np.minimum(np.diff(states), 2).sum())

    @property
    def is_even(self):
        """Is its noise the same at all times?"""
        filt = self.at_mean[-1]
        return filt.Psi.shape[-1] == len(filt.Gamma) == 1

    @property
    def can_be_filtered(self):
        """Does no more than one effect change what drives its states?"""
        even, _ = self.evenly_driven(np.zeros((1, len(self.parameters))))
        return len(even.at_mean[-1].Gamma) == 1

    @property
    def own_states(self):
        """How many states the hypothesis has itself: they come first."""
        h, dt = self.hypothesis, self.scene.dt
        return len(h.filter(dt, [p.mean for p in h.parameters]).m0)

    def states_driven(self, effect):
        """Numbers of the states whose noise an effect changes."""
        if not effect.of_white:
            return np.arange(self.own_states)
        stages = self._replace(effects=tuple(
            one for one in self.effects if one.effect is not effect)).at_mean
        for before, after in zip(stages, stages[1:]):
            if before.Psi.any() and not after.Psi.any():
                return np.arange(len(before.m0), len(after.m0))
        return np.arange(0)

    @property
    def driven(self):
        """The effect that changes the noise of its states, or None."""
        return next((one for one in self.effects if one.effect.drive and len(
            self.states_driven(one.effect))), None)

    def evenly_driven(self, theta):
        """The same without a change of the noise of its states, and theta (M, p)."""
        driven = self.driven
        if driven is None:
            return self, theta
        less = self._replace(effects=tuple(
            one for one in self.effects if one is not driven))
        return less, theta[:, [self.keys.index(key) for key in less.keys]]

    @property
    def on_average(self):
        """The same with white noise that changes as on average, where effects tell how.
        """
        return self._replace(effects=tuple(
            one._replace(effect=one.effect._replace(model=one.effect.on_average))
            if one.effect.on_average else one for one in self.effects))

    @property
    def elementwise(self):
        """Does `filter` take all nodes at once?"""
        return self.hypothesis.elementwise and all(
            one.effect.elementwise for one in self.effects if one.effect.model)

    def jumps(self, theta):
        """`Jumps` at theta (M, p), each part (M,)."""
        theta = self.in_units(theta)
        parts = [Jumps(*np.zeros((len(Jumps._fields), len(theta)))), *(
            one.effect.jumps(self.scene.dt, **self.of(one, theta))
            for one in self.effects if one.effect.jumps)]
        return Jumps(*(sum(part) for part in zip(*parts)))

    @property
    def without_jumps(self):
        """The same without effects that jump."""
        return self._replace(effects=tuple(
            one for one in self.effects if not one.effect.jumps))

    @property
    def has_jumps(self):
        return any(one.effect.jumps for one in self.effects)

    @property
    def levels(self):
        """How many of its effects are a level that changes: filters take one."""
        return sum(one.begin > 0.0 for one in self._mean_jumps())

    @property
    def steps(self):
        """Does a level move at random?"""
        return any(one.step > 0.0 for one in self._mean_jumps())

    def _mean_jumps(self):
        """`Jumps` of each effect that has them, at the middle of its parameters."""
        return [one.effect.jumps(self.scene.dt, **{
            symbol: p.mean for symbol, p in one.values.items()})
            for one in self.effects if one.effect.jumps]

    @property
    def onsets(self):
        """Keys of the onsets of effects that have one."""
        return [(one.key, next(iter(one.values))) for one in self.effects
                if one.effect.search == "onset"]

    def fixed(self, known):
        """The same with parameters of its effects fixed, by key."""
        return self._replace(effects=tuple(
            one._replace(values={
                symbol: p._replace(low=known[one.key, symbol],
                                   high=known[one.key, symbol])
                if (one.key, symbol) in known else p
                for symbol, p in one.values.items()}) for one in self.effects))

    def with_effect(self, effect, variant="", column=""):
        """The same with one more effect, its parameters free."""
        priors = {p.symbol: p for p in effect.parameters(self.scene)}
        if effect.relative_to:
            priors.update((symbol, Parameter(symbol, v, v)) for symbol, v in (
                effect.relative_to(self.scene.along(column), variant).items()))
        return self.joined(Found(effect, column, variant, priors))

    def joined(self, one):
        """The same with one more effect as `Found`, of a key of its own."""
        last = max((e.number for e in self.effects if e.name == one.name), default=0)
        return self._replace(effects=_with_even_forms(
            (*self.effects, one._replace(number=last + 1))))

    def with_prior(self, key, prior):
        """The same with another prior of the parameter (effect, symbol)."""
        effect, symbol = key
        if effect:
            return self._replace(effects=tuple(
                one._replace(values={**one.values, symbol: prior})
                if one.key == effect else one for one in self.effects))
        return self._replace(hypothesis=self.hypothesis._replace(parameters=tuple(
            prior if p.symbol == symbol else p for p in self.hypothesis.parameters)))

    def with_form(self, key, form):
        """The same with another form of the effect that has a key, if it has forms."""
        return self._replace(effects=_with_even_forms(
            one._replace(variant=form) if one.key == key and one.effect.variants
            else one for one in self.effects))

    def behind_low_passes(self, base):
        """The same with what acts on all processes, but for what the base has itself,
        acting on the white noise alone.
        """
        known = [one.key for one in base.effects]
        return self._replace(effects=tuple(
            one._replace(variant=dict(one.effect.of_all)[one.variant])
            if one.acts_on_all and one.key not in known else one
            for one in self.effects))

    def matching(self, other, theta):
        """Parameters (p,) of another member that are those of this one at theta, or
        fixed.
        """
        own = dict(zip(self.keys, theta))
        return np.array([own.get(key, p.low)
                         for key, p in zip(other.keys, other.parameters)])


def _with_even_forms(effects):
    """Effects, those in a form that takes even noise in that which stands in for it, if
    a noise changes.
    """
    effects = tuple(effects)
    if not any(one.effect.drive for one in effects):
        return effects
    return tuple(one._replace(variant=dict(one.effect.uneven).get(
        one.variant, one.variant)) for one in effects)


def members(simulator, scene):
    """The hypotheses of a simulator with the effects that are inside their filters."""
    result = []
    for h, effects in simulator.pairs:
        member = Member(h, scene, joint=simulator.joint)
        for one in effects:
            if (one.effect.model or one.effect.jumps) and not one.effect.reading:
                symbols = [p.symbol for p in one.effect.parameters(scene)]
                member = member.joined(one._replace(values={
                    symbol: one.values[symbol]
                    for symbol in dict.fromkeys([*symbols, *one.values])}))
        if member.levels > 1:
            raise ValueError(f"{h.name} has several of random_telegraph, noise_bursts "
                             "and random_steps: a simulator takes one of them")
        result.append(member)
    return tuple(result)


LONG_RECORD = 20000    # samples from which on fewer draws must do
BLOCK = 10**6    # samples of simulated records that are worked on at a time: 100 MB


def simulate_effects(simulator, scene, trials=1, seed=0, first=0):
    """Records of a simulator with effects.

    Parameters
    ----------
    simulator : Simulator
    scene : Scene
        Gives the length and the columns; its missing samples will be missing.
    trials, seed, first : int
        As for `simulate`.

    Returns
    -------
    Trials
        As `simulate` draws them, then altered. Models and jumps are part of the noise,
        signatures are added to the sum, readings come last.
    """
    inside = members(simulator, scene)
    drawn = simulate(inside, scene.dt, len(scene.y), trials, seed, first)
    for trial, y in enumerate(drawn.error):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + trial, 1)))
        number = drawn.hypothesis[trial]
        member, (_, effects) = inside[number], simulator.pairs[number]
        if member.has_jumps:
            theta = drawn.theta[trial, :len(member.parameters)]
            add_jumps(y, Jumps(*(part[0] for part in member.jumps(theta[None]))), rng)
        for one in effects:
            if one.effect.columns:
                y += signature_of(scene, one, {
                    symbol: p.quantile(rng.random()) if isinstance(p, Parameter) else p
                    for symbol, p in one.values.items()})
    for number, (_, effects) in enumerate(simulator.pairs):
        # a converter has its codes before these are rounded to whole ones, and all is
        # read before it is averaged, or interpolated
        readings = sorted((one for one in effects if one.effect.reading),
                          key=lambda one: (one.effect.comes_last,
                                           "codes" not in one.values))
        if not readings:
            continue
        own = drawn.hypothesis == number
        read = drawn.error[own] + scene.known
        for one in readings:
            one.effect.reading(scene, read, **one.values)
        drawn.error[own] = read - scene.known
    drawn.error[:, np.isnan(scene.y)] = np.nan
    return drawn


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


def add_jumps(y, jumps, rng):
    """Outliers, levels, bursts of noise and steps added to y in place."""
    if jumps.rate > 0.0:
        at = rng.random(len(y)) < jumps.rate
        y[at] += np.sqrt(jumps.variance) * rng.standard_normal(at.sum())
    if jumps.half > 0.0:
        change = rng.random(len(y)) < jumps.begin
        level = (rng.integers(2) + np.cumsum(change)) % 2
        y += jumps.half * (2.0 * level - 1.0)
    if jumps.step > 0.0:
        at = np.flatnonzero(rng.random(len(y)) < jumps.begin)
        size = np.zeros(len(y))
        size[at] = np.sqrt(jumps.step) * rng.standard_normal(len(at))
        y += np.cumsum(size)
    if jumps.louder > 0.0:
        for part in _bursts(len(y), jumps, rng):
            y[part] += np.sqrt(jumps.louder) * rng.standard_normal(len(y[part]))


def _bursts(N, jumps, rng):
    """Slices of N samples at which the second level is, one after another."""
    at, second = 0, rng.random() < jumps.share
    while at < N:
        end = at + rng.geometric(jumps.end if second else jumps.begin)
        if second:
            yield slice(at, end)
        at, second = end, not second


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
