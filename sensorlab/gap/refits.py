"""What was found, once more: all effects together, without one, in other forms."""

import numpy as np

from sensorid import side_by_side
from sensorlab.gap.account import account
from sensorlab.gap.directed import estimated_beside, nodes_for
from sensorlab.gap.effects import fixed
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.linear import part_of
from sensorlab.gap.lowpass import low_pass_of, signature_passing
from sensorlab.gap.readings import as_read
from sensorlab.gap.rival import different, values_of
from sensorlab.gap.screens import HEAD
from sensorlab.gap.standins import stand_in
from sensorlab.gap.wrong import (
    column_of, factor_of, form_of, held_by, is_single, wrong_key)


def estimated_together(full, acc, path):
    """The set of effects of a path with the parameters that its account gives them:
    each was found before the others were known, or beside some that are left out.
    """
    if not path.found:
        return path
    result, at = [], len(acc.signatures) - sum(
        bool(one.effect.columns) for one in path.found)
    scene, hypotheses = stand_in(as_read(full, acc.readings), acc)
    h = hypotheses[acc.best]
    nodes = np.array([acc.member.matching(h, theta)
                      for theta in acc.sample.nodes(nodes_for(scene) // 2)])
    for number, one in enumerate(path.found):
        if one.effect.columns:
            own, at = acc.signatures[at], at + 1
            one = one._replace(low_pass=own.found.low_pass)
            values = estimated_beside(scene, h, [
                other for other in acc.signatures if other is not own], own, nodes)
        elif is_single(one):
            values = {} if held_by(acc.signatures, one) else dict(
                factor=factor_of(wrong_key(one), acc.bases, acc))
        else:
            values = {}
            if not one.effect.reading:
                own = _inside(acc, path.found, number)
                one, values = one._replace(variant=own.variant), values_of(own, acc)
        result.append(one._replace(values={**one.values, **values}))
    return path._replace(found=tuple(result))


def _inside(acc, found, number):
    """Effect `number` of those found, as it is inside the filters of an account."""
    name = found[number].name
    later = sum(one.name == name and not is_single(one) for one in found[number + 1:])
    return [one for one in acc.member.effects if one.name == name][-1 - later]


def without(full, acc, found, number, floor=-np.inf):
    """The account less effect `number` of those found, fitted again; `floor` as for
    `account`.
    """
    one = found[number]
    hypotheses, signatures = acc.hypotheses, acc.signatures
    if one.effect.reading:
        return _without_reading(full, acc, one)
    if one.effect.columns:
        # those of the simulator come first
        at = len(signatures) - sum(bool(f.effect.columns) for f in found[number:])
        signatures = signatures[:at] + signatures[at + 1:]
    elif held := held_by(signatures, one):
        signatures = tuple(s._replace(gain=0.0) if s is held[0] else s
                           for s in signatures)
    elif is_single(one):
        key = wrong_key(one)
        hypotheses = [
            h if column_of(base, key) is None else h.with_prior(
                key, base.parameters[column_of(base, key)]).with_form(
                    key[0], form_of(acc.bases, key[0]))
            for h, base in zip(hypotheses, acc.bases)]
    else:
        key = _inside(acc, found, number).key
        hypotheses = [h._replace(effects=tuple(
            e for e in h.effects if e.key != key)) for h in hypotheses]
    return account(as_read(full, acc.readings), acc.bases, hypotheses, signatures,
                   acc.readings, acc, floor)


RATIOS = 1.3, 1.09, 1.03    # of the parameters at which forms are compared


def in_best_forms(full, acc, found):
    """The account with the effects inside its filters in the forms that are likeliest
    beside all that is found now: while outliers are not known, they fill the band that
    a low-pass stops, and hide its form. Of a long record the head tells which it is.
    """
    in_forms = [n for n, one in enumerate(found)
                if one.effect.model and one.effect.variants]
    if not in_forms:
        return acc
    scene = as_read(full, acc.readings)
    head = slice(None if acc.member.onsets else HEAD)
    for number in in_forms:
        own = _inside(acc, found, number)
        forms = [(hypotheses, signatures) for form, hypotheses in different(
            (form, [h.with_form(own.key, form) for h in acc.hypotheses])
            for form in (own.variant, *acc.member.forms(own.effect)))
            for signatures in _before_or_after(acc, hypotheses, scene)]
        if len(forms) < 2:
            continue
        here, *others = side_by_side(lambda form: _near(
            *part_of(scene, form[1], head), acc, form[0][acc.best], own.key), forms)
        best = int(np.argmax(others))
        if others[best] > here:
            new = account(scene, acc.bases, *forms[1 + best], acc.readings, acc)
            acc = max(acc, new, key=lambda either: either.log_evidence)
    return acc


def _before_or_after(acc, hypotheses, scene):
    """The signatures of an account as they are, and, if its hypotheses are to have a
    low-pass that all passes: those that pass one as they pass it, and all of them.
    """
    yield acc.signatures
    h = hypotheses[acc.best]
    low_pass, known = low_pass_of(h, acc.member.matching(h, acc.theta)), acc.signatures
    for every in (False, True) if low_pass else ():
        passed = tuple(signature_passing(low_pass, one, scene, every) for one in known)
        if any(one is not own for one, own in zip(passed, known)):
            yield passed
        known = passed


def _near(scene, signatures, acc, h, key):
    """Largest log-likelihood of a hypothesis at parameters that an account has, but for
    those of the effect of a key, which are near these.
    """
    theta, best = acc.member.matching(h, acc.theta), -np.inf
    columns = [c for c, (effect, _) in enumerate(h.keys)
               if effect == key and h.parameters[c].free]
    for ratio in RATIOS:
        for column in columns:
            tried = np.repeat(theta[None], 3, axis=0)
            tried[:, column] = np.clip(theta[column] * ratio**np.arange(-1.0, 2.0),
                                       h.parameters[column].low,
                                       h.parameters[column].high)
            told = log_likelihoods(h, scene, signatures, tried)
            theta, best = tried[told.argmax()], max(best, told.max())
    return best


def _without_reading(full, acc, one):
    """The account less a reading, or with the simulator's own instead."""
    (gone,) = [r for r in acc.readings if r.found.effect.reading is one.effect.reading]
    if gone.beyond:    # within limits there is no such record
        return acc
    readings = tuple(gone.instead if r is gone else r for r in acc.readings
                     if r is not gone or gone.instead)
    own = fixed(**gone.instead.found.values) if gone.instead and (
        gone.found.effect.model) else {}    # which filters see
    hypotheses = [h._replace(effects=tuple(
        e._replace(values=own or e.values) if e.name == gone.found.name else e
        for e in h.effects if own or e.name != gone.found.name))
        for h in acc.hypotheses]
    return account(as_read(full, readings), acc.bases, hypotheses, acc.signatures,
                   readings, acc)
