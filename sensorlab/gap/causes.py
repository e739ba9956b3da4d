"""Which: one more effect at a time."""

from typing import NamedTuple

import numpy as np

from sensorid import Parameter, bank, free_columns, probabilities
from sensorlab.gap.effects import extend, flicker_times
from sensorlab.gap.filters import _value
from sensorlab.gap.evidence import HOPELESS
from sensorlab.gap.signatures import estimate_signature, searches, signature_evidence
from sensorlab.gap.account import Account, _gaussian, _guess, _mean_evidence, account


class Cause(NamedTuple):
    """An effect as the explanation of a record."""

    effect: str
    column: str         # "a or b" where columns are alike
    probability: float
    log_bayes: float
    parameters: dict    # name -> (mean, sd)


class Step(NamedTuple):
    """One look for a further effect."""

    causes: tuple      # of Cause, most probable first, "none" among them
    account: Account   # with the most probable effect in it; None where it is "none"


LISTED = 0.01       # probability from which on a cause is worth its parameters
PRIOR_NONE = 0.5    # that nothing is missing
PRIOR_LAST = 0.75   # that nothing more is: a second effect is half as likely as a first


def look(scene, acc, effects, processes=True):
    """`Step`: probability of every further effect, Eq. (10), and the best account.

    Without `processes`, for signatures and jumps alone.
    """
    plain, hypotheses = _gaussian(scene, acc)
    reference = acc if plain is scene else account(
        plain, hypotheses, signatures=acc.signatures)
    tries = searches(plain, effects, acc.signatures)
    samples = [signature_evidence(h, plain, acc.signatures, tries,
                                  _guess(reference, number))
               for number, h in enumerate(hypotheses)]
    table = np.array([s.log_evidence for s in samples])
    log_bayes, accounts, parameters = {}, {}, {}

    def enter(name, new, old, values):
        """A richer account: where in its ranges the base lies is no evidence against
        it, so ln B is no more than the likelihood ratio less Akaike's correction.
        """
        more = max(len(free_columns(h.parameters)) - len(free_columns(o.parameters))
                   for h, o in zip(new.hypotheses, old.hypotheses))
        log_bayes[name] = min(new.log_evidence - old.log_evidence,
                              new.peak - old.peak - max(more, 1))
        accounts[name], parameters[name] = new, values
    base = _mean_evidence(table[:, 0])
    for number, t in enumerate(tries):
        log_bayes[t.effect.name, t.column] = (
            _mean_evidence(table[:, 1 + number]) - base)
    for e in effects:
        start, at = (reference, plain) if e.kind == "process" else (acc, scene)
        if not processes and e.kind != "jumps":
            continue
        if e.kind in ("process", "jumps") and _fits(e, acc, scene):
            new = account(at, acc.bases, [extend(at, h, e) for h in start.hypotheses],
                          acc.signatures, acc.readings, start,
                          start.log_evidence + HOPELESS)
            enter((e.name, ""), new, start, _account_parameters(e.name, new))
        elif e.kind == "parameter":
            for p, new, factor in wrong_parameters(scene, acc):
                enter((e.name, p), new, acc, dict(parameter=(p, 0.0), factor=factor))
    names = list(log_bayes)
    first = not (acc.signatures or acc.readings or acc.hypotheses[0].parameters
                 != acc.bases[0].parameters)
    alone = PRIOR_NONE if first else PRIOR_LAST
    share = np.array([_share(acc, *name) for name in names])
    probability = probabilities([np.log(alone), *(
        np.log((1.0 - alone) * share / share.sum())
        + [log_bayes[name] for name in names])])
    # columns are rivals in where an effect comes from, not in what it is
    own = {}
    for i in np.argsort(-probability[1:]):
        own.setdefault(names[i][0], []).append(i)
    total = {effect: float(probability[1:][i].sum()) for effect, i in own.items()}
    best = names[own[max(total, key=total.get)][0]] if own else None
    estimates = {}
    for number, t in enumerate(tries, 1):
        name = t.effect.name, t.column
        if name == names[own[name[0]][0]] and (
                total[name[0]] > LISTED or name == best):
            estimates[name], parameters[name] = estimate_signature(
                hypotheses, plain, acc.signatures, t, samples, number)
    chosen = None
    if probability[0] < 0.5:
        if best in accounts:
            chosen = accounts[best]
            effect = next(e for e in effects if e.name == best[0])
            if plain is not scene and effect.kind == "process":
                chosen = account(scene, acc.bases, [
                    extend(scene, h, effect) for h in acc.hypotheses],
                    acc.signatures, acc.readings, acc)
        else:
            chosen = account(scene, acc.bases, acc.hypotheses,
                             (*acc.signatures, estimates[best]), acc.readings, acc)
        if plain is not scene and (
                chosen.log_evidence - acc.log_evidence < np.log(len(names))):
            # what stood in for the jumps misled: the filter with jumps sees nothing
            return look(scene, acc, [e for e in effects if e.name != best[0]],
                        processes)
    causes = [Cause(effect, "" if effect == "wrong_parameter" else _either(
                        [names[i][1] for i in rivals if
                         probability[1 + i] > 0.1 * probability[1 + rivals[0]]]),
                    total[effect], float(log_bayes[names[rivals[0]]]),
                    parameters.get(names[rivals[0]], {}))
              for effect, rivals in own.items()]
    causes.append(Cause("none", "", float(probability[0]), 0.0, {}))
    causes.sort(key=lambda c: -c.probability)
    return Step(tuple(causes), chosen)


def _either(columns):
    """Columns of which any may be the cause, as text."""
    return " or ".join(columns if len(columns) <= 3 else
                       [*columns[:2], f"{len(columns) - 2} others"])


def _share(acc, effect, symbol):
    """Prior of an effect, relative to others: ranges are seldom wrong, numbers often.
    """
    ranged = effect == "wrong_parameter" and all(
        p.free for h in acc.hypotheses for p in h.parameters if p.symbol == symbol)
    return 0.1 if ranged else 1.0


def _fits(effect, acc, scene):
    """Is there room for a process or jumps that are not there yet?"""
    symbols = [p.symbol for p in acc.hypotheses[0].parameters]
    if any(s.startswith(effect.name + ".") for s in symbols):
        return False
    more = dict(bias_instability=len(flicker_times(scene))).get(
        effect.name, effect.kind == "process")
    return max(_states(h, scene.dt) for h in acc.hypotheses) + more <= 6


def _states(h, dt):
    return bank(h, dt, [[p.mean for p in h.parameters]]).m0.shape[1]


def _account_parameters(effect, acc):
    """Mean and standard deviation of an effect's parameters over all hypotheses."""
    share = probabilities([s.log_evidence[0] for s in acc.samples])
    symbols = [p.symbol for p in acc.hypotheses[0].parameters
               if p.symbol.startswith(effect + ".")]
    result = {}
    for symbol in symbols:
        first = second = 0.0
        for h, sample, part in zip(acc.hypotheses, acc.samples, share):
            value = _value(h, sample.theta, symbol)
            first += part * sample.weight @ value
            second += part * sample.weight @ value**2
        result[symbol.split(".")[1]] = (float(first),
                                        float(np.sqrt(max(second - first**2, 0.0))))
    return result


OFF = 1000.0    # a wrong parameter is wrong by less than this factor


def wrong_parameters(scene, acc):
    """Accounts in which one parameter of the simulator may leave its bounds.

    A range is left alone unless the record pushes against one of its ends.
    """
    for symbol in dict.fromkeys(p.symbol for h in acc.hypotheses for p in h.parameters
                                if "." not in p.symbol):
        pushed, new = False, []
        for h, sample in zip(acc.hypotheses, acc.samples):
            symbols = [p.symbol for p in h.parameters]
            if symbol not in symbols or h.parameters[symbols.index(symbol)].high <= 0.0:
                new.append(h)
                continue
            at = symbols.index(symbol)
            p, value, w = h.parameters[at], sample.theta[:, at], sample.weight
            mean = w @ value
            sd = np.sqrt(w @ (value - mean)**2)
            near = min(mean - p.low, p.high - mean) < 2.0 * sd and sd < 0.2 * p.sd
            pushed |= near or not p.free
            wide = Parameter(symbol, (p.low or 1e-3 * p.high) / OFF, p.high * OFF, True)
            new.append(h._replace(parameters=(
                *h.parameters[:at], wide, *h.parameters[at + 1:])))
        if pushed:
            wide = account(scene, acc.bases, new, acc.signatures, acc.readings)
            yield symbol, wide, _factor(symbol, acc, wide)


def _factor(symbol, acc, wide):
    """A parameter over what the simulator has, or its nearest end: mean, sd."""
    symbols = [p.symbol for p in wide.hypotheses[wide.best].parameters]
    if symbol not in symbols:
        return 1.0, 0.0
    at = symbols.index(symbol)
    p, sample = acc.hypotheses[wide.best].parameters[at], wide.samples[wide.best]
    value = sample.theta[:, at]
    mean = sample.weight @ value
    sd = np.sqrt(sample.weight @ (value - mean)**2)
    reference = np.clip(mean, p.low, p.high) or 1.0
    return float(mean / reference), float(sd / reference)
