"""What a simulator knows within a range, as a record has it: the frequency of a line,
by how much a temperature lags.
"""

import numpy as np

from sensorlab.gap.backward import solve
from sensorlab.gap.effects import columns_of
from sensorlab.gap.linear import Signature
from sensorlab.gap.members import members
from sensorlab.gap.scans import SCANS
from sensorlab.gap.signatures import Family, scores_at

TRIED = 64    # values of a range, or about the best frequency of a line


def tuned(simulator, scene):
    """The simulator, with numbers for what its signatures depend on beside their sizes:
    of each range the value at which what it is of explains most of a scene.

    Raises
    ------
    ValueError
        If the time at which something begins has a range.
    """
    effects = list(simulator.pairs[0][1])
    for number, one in enumerate(effects):
        ranged = _ranged(one)
        if ranged and one.effect.begins:
            raise ValueError(f"{one.name} of the simulator has a range of "
                             f"{', '.join(ranged)}: diagnose needs numbers where "
                             "something begins at some time, but for its size")
        for symbol in ranged:
            best = _best(simulator, effects, number, symbol, scene)
            effects[number] = one = one._replace(values={
                **one.values, symbol: one.values[symbol]._replace(low=best, high=best)})
    return simulator._replace(effects=(tuple(effects),) * len(simulator.hypotheses))


def _ranged(one):
    """Symbols of what the columns of an effect depend on and has a range."""
    if not one.effect.columns:
        return []
    return [symbol for symbol, p in one.values.items() if getattr(p, "free", False)
            and symbol not in (one.effect.size, "phase")]


def _best(simulator, effects, number, symbol, scene):
    """The value of a parameter at which an effect explains most, beside the others."""
    own, spread = effects[number], float(np.nanstd(scene.y)) or 1.0
    member = members(simulator, scene)[0].without_jumps
    theta = np.array([[p.mean for p in member.parameters]])
    others = [Signature(one, columns_of(scene, one, _at_middle(one)), spread)
              for k, one in enumerate(effects) if one.effect.columns and k != number]
    centred = scene._replace(y=scene.y - np.nanmean(scene.y))
    solved = solve(member, centred, others, theta, own.low_pass)
    prior = own.values[symbol]
    family = Family(own.effect, own.column, variant=own.variant, low_pass=own.low_pass)
    psi = prior.quantile(np.linspace(0.0, 1.0, TRIED))
    if own.effect.search == "frequency":
        top, apart = _best_line(centred, family, solved, prior), 1.0 / scene.duration
        psi = np.linspace(*np.clip([top - apart, top + apart], prior.low, prior.high),
                          TRIED)
    found = scores_at(centred, family, solved, psi.tolist())
    return float(found.psi[found.gain[0].argmax()])


def _best_line(scene, family, solved, prior):
    """The frequency within a range of which the gain is largest; its middle where it is
    narrower than what a record resolves.
    """
    best, result = -1.0, prior.mean
    for part in SCANS["frequency"](scene, family, solved):
        psi, _ = part.of(np.arange(len(part.gain)))
        gain = np.where((psi >= prior.low) & (psi <= prior.high), part.gain, -1.0)
        if gain.max() > best:
            best, result = gain.max(), float(psi[gain.argmax()])
    return result


def _at_middle(one):
    """Values of an effect with the middle of every range."""
    return {symbol: getattr(p, "mean", p) for symbol, p in one.values.items()}
