"""Two effects at a time, where neither explains much without the other.

All pairs of a coarse list of signatures are tried on the scores of one filter, and the
best are sought exactly. Beside what is the first to be odd or to jump, and beside a
process for which jumps may stand in, any effect is sought.
"""

import itertools
from typing import NamedTuple

import numpy as np

from sensorid import brief, mesh, middles, side_by_side
from sensorlab.gap.account import account
from sensorlab.gap.causes import further_causes
from sensorlab.gap.effects import Found
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.linear import Signature, filter_of, part_of
from sensorlab.gap.rival import log_bayes_over, with_signature
from sensorlab.gap.screens import HEAD, LAWS, LITTLE
from sensorlab.gap.signatures import Family, columns_at, families
from sensorlab.gap.sought import NO_OTHER
from sensorlab.gap.standins import gaussian

ONSETS = 48          # of a step
ENDS = 24            # onsets of what lasts
PARTS = 2.0, 4.0, 8.0, 16.0          # of a record, that it may last
CYCLES = np.arange(1.0, 8.5, 0.5)    # in a record: more are like no other form
BINS = 4096          # of the scores of a long record
LOST = 0.1           # of ln B, by a coarse list
ALIKE = 1e-4         # of its information, that is left to a form beside another
STARTS = 2           # pairs of effects that are sought exactly
MOST_OF = 0.5        # of ln B of the best cause
MOST_IN_GRID = 4     # parameters
EVEN_BETTER = 0.3    # nats that a further round must gain


def best_pair(scene, acc, look, effects, describes):
    """(found, ln B, account) of two effects that explain more together than alone: of
    two signatures, of odd samples and a signature, or of any two for which jumps may
    stand in. None if the best cause of a look beyond an account is a signature.

    `describes` tells whether the best leaves nothing: jumps that do stand in for none.
    """
    best, *others = [c for c in look.causes if c.found]
    if best.found[0].effect.columns:
        return None
    forms, pairs = [e for e in effects if e.columns], []
    for signature in _starts(scene, acc, forms, best.log_bayes):
        pairs += _ever_better(scene, acc, with_signature(scene, acc, signature), forms,
                              forms)
    jumps = bool(best.found[0].effect.jumps) and not (
        acc.member.has_jumps or describes())
    some = [e for e in effects if not e.factor] if jumps else forms
    inside = [] if acc.member.has_jumps else [
        c.found[0].effect for c in others
        if (c.effect in LAWS or jumps and not c.found[0].effect.columns) and (
            c.log_bayes > MOST_OF * best.log_bayes)
        or c.effect in LAWS and jumps and c.log_bayes > LITTLE
        and _stood_in_for(c.found[0].effect, scene, look.account)]

    def beside(effect):
        look = further_causes(scene, acc, [effect])
        return [] if look.account is None else _ever_better(
            scene, acc, look.account, some, [effect],
            next(c for c in look.causes if c.found), max(
                [best.log_bayes, *map(_worth, pairs)]))
    for effect in sorted(inside, key=lambda e: e.name not in LAWS)[:STARTS]:
        pairs += beside(effect)
    if best.effect in LAWS:    # the next look is beside it
        pairs = [pair for pair in pairs if best.effect not in [f.name for f in pair[0]]]
    pair = max(pairs, key=_worth, default=None)
    if jumps and pair and pair[1] > best.log_bayes and any(
            _worth(other) > pair[1] for other in _ever_better(
                scene, acc, look.account, some, [best.found[0].effect], best)):
        return None    # the next look finds what is better beside the best
    return pair


STOOD_IN = 3    # values of each parameter of what jumps and what is odd


def _stood_in_for(odd, scene, acc):
    """Are odd samples beside the last effect of an account, which jumps, likelier than
    that alone, somewhere? A sample that is odd is two jumps, and then none are left.
    """
    h = acc.member.with_effect(odd)
    own = [k for k, key in enumerate(h.keys) if key[0] in (
        h.effects[-2].key, h.effects[-1].key)]
    if len(own) > MOST_IN_GRID or h.onsets:
        return False
    head = part_of(scene, acc.signatures, slice(HEAD))
    u = mesh(*len(own) * [middles(STOOD_IN)])
    theta = np.tile(acc.member.matching(h, acc.theta), (len(u), 1))
    for column, values in zip(own, u.T):
        theta[:, column] = h.parameters[column].quantile(values)
    return log_likelihoods(h, *head, theta).max() > log_likelihoods(
        acc.member, *head, acc.theta[None])[0]


def _worth(pair):
    return pair[1]


def _with_last(scene, acc, other):
    """An account with what was the last to come into another, richer one."""
    if len(other.signatures) > len(acc.signatures):
        return with_signature(scene, acc, other.signatures[-1])
    return account(scene, acc.bases, [
        h.joined(own.effects[-1]) for h, own in zip(acc.hypotheses, other.hypotheses)
    ], acc.signatures,
        acc.readings, acc)


def _ever_better(scene, acc, beside, effects, own, first=None, least=0.0):
    """Pairs of effects: beside the one in the account `beside`, which is the cause
    `first` if that is known well, any of some effects is sought, beside that one of its
    `own`, which may be the same again in another form, and so on. A pair of less than
    the `least` ln B need not be known well.
    """
    found, worth, best = (), 0.0, -np.inf
    forms = all(e.columns for e in own)
    while True:
        some = own if found else effects
        look = further_causes(scene, beside, some, not all(
            e.columns or e.jumps for e in some), known=("", max(
                least - first.log_bayes, 0.0)) if first and not found else NO_OTHER)
        if look.account is None:
            return
        other = next(c for c in look.causes if c.found)
        gain = look.account.log_evidence - beside.log_evidence
        # a process was sought where no jumps are: beside them it may be worth more
        log_bayes = other.log_bayes if (
            other.found[0].effect.columns or not beside.member.has_jumps
        ) else log_bayes_over(look.account, beside)
        if found:
            if worth + log_bayes < best + EVEN_BETTER:
                return
            best = worth + log_bayes
            yield found + other.found, best, look.account
            if not forms:
                return
        elif first:
            best = first.log_bayes + log_bayes
            yield first.found + other.found, best, look.account
        # the other alone, less what it takes to seek it
        beside, found = _with_last(scene, acc, look.account), other.found
        worth = beside.log_evidence - acc.log_evidence - (gain - log_bayes)


class _Form(NamedTuple):
    """A signature of the coarse list."""

    family: Family
    psi: object
    variant: str
    first: int     # number of its only column, or of the first of two
    last: int
    cost: float    # ln of how many there are of the family

    __repr__ = brief


def _starts(scene, acc, forms, least):
    """The better `Signature` of each of the best pairs, no two of the same effects."""
    plain, hypotheses = gaussian(scene, acc)
    h, gap = hypotheses[acc.best], np.isnan(plain.y)
    own = filter_of(h, plain, acc.signatures, acc.member.matching(h, acc.theta), gap)
    edges = np.arange(min(len(gap), BINS)) * len(gap) // min(len(gap), BINS)

    def white(rows):
        z = np.nan_to_num(own.whitened(np.where(gap, np.nan, rows)))
        return np.add.reduceat(z, edges, axis=1) / np.sqrt(np.diff(
            edges, append=len(gap)))
    listed, z = [], [white(plain.y[None])]
    for family in families(plain, forms, acc.signatures):
        every = list(itertools.chain(*side_by_side(lambda psi: [
            (psi, variant, white(columns.T))
            for psi, variant, columns in columns_at(plain, family, [psi])],
            _coarse(plain, family))))
        for psi, variant, rows in every:
            listed.append(_Form(family, psi, variant, len(z), len(z) + len(rows) - 1,
                                np.log(len(every))))
            z.extend(rows[:, None])
    if not listed:
        return
    z = np.vstack(z)
    J = row_products(z, z)
    first, last, cost = np.array([(f.first, f.last, f.cost) for f in listed]).T
    first, last = first.astype(int), last.astype(int)
    worth = 0.5 * _gains(J, first, last) - cost[:, None] - cost
    kind = np.unique([f.family.effect.name + f.family.column for f in listed],
                     return_inverse=True)[1]
    for _ in range(STARTS):
        i, k = np.unravel_index(worth.argmax(), worth.shape)
        if worth[i, k] < (1.0 - LOST) * least:
            return
        best = max(i, k, key=lambda at: J[0, first[at]]**2 / J[first[at], first[at]])
        yield _signature(plain, listed[best], J)
        for a, b in ((i, k), (k, i)):
            worth[np.ix_(kind == kind[a], kind == kind[b])] = -np.inf


def _coarse(scene, family):
    """Values of the parameter of a family in the coarse list."""
    T, search = scene.duration, family.effect.search
    if search == "onset":
        return (T * middles(ONSETS)).tolist()
    if search == "pulse":
        return [(onset, T / part) for part in PARTS
                for onset in (T * middles(ENDS)).tolist()]
    if search == "frequency":
        return (CYCLES / T).tolist()
    return family.psi or []    # waves are like no other form


def _gains(J, first, last):
    """Squared standard scores (F, F) of the sizes of any two signatures, of which there
    is one column or two, numbers first (F,) and last (F,) in the products J (c, c) of
    whitened rows, the record before all columns; -inf where one is like the other.
    """
    result, two = np.zeros((len(first), len(first))), first != last
    for i in range(len(first)):
        own = np.unique([first[i], last[i]])
        part = np.linalg.pinv(J[np.ix_(own, own)]) @ J[own]

        def left(a, b):
            return J[a, b] - np.einsum("kf, kf -> f", J[own][:, a], part[:, b])
        record = np.zeros_like(first)
        x, y = left(record, first), left(record, last)
        p, q, r = left(first, first), left(first, last), left(last, last)
        apart = np.where(two, p * r - q * q, p)
        least = np.where(two, ALIKE * J[last, last], 1.0) * ALIKE * J[first, first]
        gain = np.where(two, x * x * r - 2.0 * x * y * q + y * y * p, x * x)
        result[i] = J[0, own] @ part[:, 0] + np.where(
            apart > least, gain / np.maximum(apart, 1e-300), -np.inf)
    return result


def _signature(scene, form, J):
    """`Signature` of a form of the coarse list, about as large as in the record."""
    effect, column = form.family.effect, form.family.column
    ((_, _, columns),) = columns_at(scene, form.family._replace(
        variant=form.variant), [form.psi])
    own = np.arange(form.first, form.last + 1)
    size = float(np.linalg.norm(np.linalg.pinv(J[np.ix_(own, own)]) @ J[own, 0]))
    values = dict(zip((p.symbol for p in effect.parameters(scene)),
                      np.atleast_1d(form.psi).tolist()))
    return Signature(Found(effect, column, form.variant, {**values, effect.size: size}),
                     columns, 3.0 * size)
