"""A simulator with effects: hypotheses with those that are inside their filters."""

from typing import NamedTuple

import numpy as np

from sensorid import Hypothesis, Parameter, brief
from sensorlab.gap.effects import Found, Jumps, Scene


class Simulator(NamedTuple):
    """Hypotheses, equally probable, and the effects of each."""

    hypotheses: tuple     # of Hypothesis
    effects: tuple = ()   # of every hypothesis a tuple of Found; () if none has any
    joint: object = None  # `Joint` of the parameters, where a record tells them
    records: object = None    # (L, N) array, u, where these are all that is known of it

    @property
    def pairs(self):
        """(hypothesis, its effects) of all."""
        effects = self.effects or ((),) * len(self.hypotheses)
        if len(effects) != len(self.hypotheses):
            raise ValueError(f"a simulator with {len(self.hypotheses)} hypotheses and "
                             f"the effects of {len(effects)}: a tuple for each is "
                             "needed")
        return tuple(zip(self.hypotheses, effects))


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
        """What a model, or jumps, take beside the parameters of an effect."""
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
        if self.driven and self.is_louder_before:
            return False
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
            one.effect.jumps(self.scene.dt, **self._form(one), **self.of(one, theta))
            for one in self.effects if one.effect.jumps)]
        return Jumps(*(sum(part) for part in zip(*parts)))

    def white(self, theta):
        """Standard deviation (M,) of the white noise at theta (M, p)."""
        return self.value(self.in_units(theta), "", "sigma_v")

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
    def moves_a_level(self):
        """Does one of its effects move the value for a while?"""
        return any(one.half > 0.0 or one.step > 0.0 for one in self._mean_jumps())

    @property
    def has_a_filter(self):
        """Does it have no more of all that changes than a filter takes?"""
        return self.levels <= 1 and self.can_be_filtered

    @property
    def low_pass_of_levels(self):
        """The effect, `Found`, that is a low-pass which a level that changes passes,
        and the numbers of its states, but for that of its noise, if it has one; None
        and no number without.
        """
        models = [one for one in self.in_turn if one.effect.model]
        at = next((k for k, one in enumerate(models) if one.acts_on_all), None)
        if at is None or not self.moves_a_level:
            return None, np.zeros(0, int)
        before, after = (len(filt.m0) for filt in self.at_mean[at:at + 2])
        return models[at], np.arange(before, max(after - 1, before + 1))

    @property
    def steps(self):
        """Does a level move at random, and stay?"""
        return any(one.step > 0.0 and not one.before for one in self._mean_jumps())

    @property
    def moves_a_state(self):
        """Is there a state that nothing but jumps moves, the first of the effects'?"""
        return any(one.step > 0.0 for one in self._mean_jumps())

    @property
    def moves_once(self):
        """Does what moves the value not stay?"""
        return any(one.step > 0.0 and one.before for one in self._mean_jumps())

    @property
    def is_louder_before(self):
        """Is the white noise louder at times before a low-pass?"""
        return any(one.louder > 0.0 and one.before for one in self._mean_jumps())

    def forms(self, effect):
        """The forms of an effect that differ here and may be joined; "" if it has but
        one.
        """
        other = self._replace(effects=tuple(
            one for one in self.effects if one.effect is not effect))
        passes = ("", "sigma_v") in self.keys and any(
            one.acts_on_all for one in self.effects)
        return [form for form in effect.variants or ("",) if form not in effect.before
                or passes and other.with_effect(effect, form).has_a_filter]

    def _mean_jumps(self):
        """`Jumps` of each effect that has them, at the middle of its parameters."""
        return [one.effect.jumps(self.scene.dt, **self._form(one), **{
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
        return self._replace(effects=with_even_forms(
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
        return self._replace(effects=with_even_forms(
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

    @property
    def with_low_passes_of_all(self):
        """The same with what acts on the white noise alone acting on all processes, if
        that is the same of white noise.
        """
        return self._replace(effects=with_even_forms(
            one._replace(variant=next((every for every, white in one.effect.of_all
                                       if white == one.variant in one.effect.alike),
                                      one.variant)) for one in self.effects))

    def matching(self, other, theta):
        """Parameters (p,) of another member that are those of this one at theta, or
        fixed.
        """
        own = dict(zip(self.keys, theta))
        return np.array([own.get(key, p.low)
                         for key, p in zip(other.keys, other.parameters)])


def with_even_forms(effects):
    """Effects, those in a form that acts on all processes acting on the white noise
    alone, if what drives the hypothesis's own states changes.
    """
    effects = tuple(effects)
    if not any(one.effect.drive and not one.effect.of_white for one in effects):
        return effects
    return tuple(one._replace(variant=dict(one.effect.of_all).get(
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
