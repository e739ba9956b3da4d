"""Fresh records of tests/generator.py, which shares no code with the module: verdicts
against severity, beside the Bayes-optimal classifier and simple ones.

Left: effects named rightly against severity, the signal-to-noise ratio that a matched
filter would give an additive effect beside the best simulator without it (sqrt(2 D), D
the mean divergence in nats); additive effects alone for the bound, which knows the
severity and has no other effects to mind.
Right: false alarms over records without an effect, half of them at the edges of the
prior. The random forest needs scikit-learn (`pip install -e ".[bench]"`).
"""

import json

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import ive
from scipy.stats import chi2

import figures
import sensorid
import sensorlab
from sensorlab.drawings.style import AFTER, BEFORE, INK, PALE, legend_above
from sensorlab.gap import signatures
from sensorlab.gap.account import account
from sensorlab.gap.directed import directed
from sensorlab.gap.members import Simulator, members
from figures import save, withheld
from tests import generator

SEED = 2026
NONE, REPEATS, PAIRS, OUTSIDE = 1000, 5, 60, 10    # records: none; of each effect, ...
TRAIN = 3000    # records that the forest learns from
COLOURS = AFTER, "#7fb0dd", INK, BEFORE, PALE, "#b58a2e"


def plan():
    """(number, effects, level) of every record that is made."""
    quick = figures.size["trials"] < 500
    none, repeats, pairs, outside = (20, 1, 4, 1) if quick else (
        NONE, REPEATS, PAIRS, OUTSIDE)
    effects = generator.ADDITIVE + generator.OTHERS
    listed = [((), 0)] * none
    listed += [((e,), level) for _ in range(repeats) for level in (1, 2, 3, 4)
               for e in effects]
    rng = np.random.default_rng(SEED)
    free = [e for e in effects if e not in ("quantization", "saturation", "stuck")]
    listed += [(tuple(rng.choice(free, 2, replace=False)), 3) for _ in range(pairs)]
    listed += [((e,), 3) for _ in range(outside) for e in generator.OUTSIDE]
    return [(number, *one) for number, one in enumerate(listed)]


def made(number, effects, level):
    return generator.record(SEED, number, effects, level or 3,
                            edge=not effects and number % 2 == 0)


def profiled(record, hypotheses):
    """min over the base of KL(record's law || base) of an additive effect, nats.

    The signature exactly; the noise by its spectrum (Whittle, first differences).
    """
    p, name = record["parameters"], record["base"]
    shape = record["error"] - record["clean"]
    if not np.any(shape):
        return 0.0
    scene = sensorlab.Scene(shape, generator.DT, {})
    w = np.pi * (np.arange(generator.N // 2) + 0.5) / (generator.N // 2)

    def spectrum(a, q, r):
        turn = 2.0 - 2.0 * np.cos(w)
        return turn * r + turn * q / ((1.0 - a)**2 + a * turn)
    a = 1.0 if name == "random_walk" else np.exp(-generator.DT / p["tau_m"])
    q = (p["sigma_w"]**2 if name == "random_walk" else p["sigma_m"]**2 * (1.0 - a * a))
    true = spectrum(a, q, p["sigma_v"]**2)
    best = np.inf
    rng = np.random.default_rng(0)
    for h in hypotheses:
        theta = np.column_stack([rng.uniform(x.low, x.high, 400) for x in h.parameters])
        white = p["sigma_v"] * np.exp(rng.uniform(-0.1, 0.1, 400))
        theta[:, -1] = np.clip(white, 0.25, 1.0)
        if h.name == name:
            theta[0] = [p[x.symbol] for x in h.parameters]
        b = sensorid.bank(h, generator.DT, theta)
        sums = next(sensorid.filter_bank(b, shape[None], [len(scene.y)]))
        chi = sums.chi2[0] - sums.score[0]**2 / (1.0 + sums.information)
        for j in range(len(theta)):
            ratio = true / spectrum(b.Phi[j, 0, 0, 0], b.Q[j, 0, 0, 0], b.r[j, 0])
            best = min(best, 0.5 * chi[j] + 0.5 * np.sum(ratio - 1.0 - np.log(ratio)))
    return float(best)


def bound(record, level, hypotheses):
    """The Bayes-optimal name among the additive effects and none, severity known."""
    scene = sensorlab.Scene(record["error"], generator.DT,
                           dict(temperature=record["temperature"], rate=record["rate"]))
    D = generator.LEVELS[level]
    x = withheld.ratio(D) * signatures.GAIN_ROOT
    table = {1: x + np.log1p(np.exp(-2.0 * x)) - np.log(2.0) - D,
             2: np.log(ive(0, x)) + x - D}
    effects = [sensorlab.CATALOGUE[e] for e in generator.ADDITIVE]
    tries = signatures.families(scene, effects)
    base = account(scene, members(Simulator(hypotheses), scene))
    total = np.logaddexp.reduce([
        sample.log_evidence for sample in directed(scene, base, tries, table)])
    return ["none", *(t.effect.name for t in tries)][int(np.argmax(total))]


def features(record):
    """What a classifier is given: Allan slopes, correlations, moments, lines, ties."""
    y, T, rate = record["error"], record["temperature"], record["rate"]
    d = np.diff(y)
    d0 = (d - d.mean()) / d.std()
    adev = sensorid.allan_deviation(y, generator.DT)[1]
    out = [*np.diff(np.log(adev)), np.log(d.std())]
    out += [np.mean(d0[k:] * d0[:-k]) for k in (1, 2, 3, 5, 8, 16, 32)]
    size = np.abs(d0) - np.abs(d0).mean()
    out += [np.mean(size[k:] * size[:-k]) for k in (1, 2, 5, 20)]
    out += [np.mean(d0**3), np.log(np.mean(d0**4)), np.abs(d0).max()]
    power = np.abs(np.fft.rfft(d0))[1:]**2 / len(d0)
    out += [np.log(part.max() / np.median(part)) for part in np.array_split(power, 8)]
    parts = np.array_split(y, 8)
    out += [part.mean() - y.mean() for part in parts] + [np.log(np.diff(p).std())
                                                         for p in parts]
    for x in (T, rate, rate**2, np.gradient(rate), np.arange(len(y))):
        out += [np.corrcoef(y, x)[0, 1], np.corrcoef(d, np.diff(x) + 1e-12 * d)[0, 1]]
    step = [abs(y[i:i + 40].mean() - y[i - 40:i].mean()) for i in
            range(40, len(y) - 40, 20)]
    out += [max(step) / np.median(step), np.mean(d == 0.0),
            np.mean(y == y.max()) + np.mean(y == y.min()), len(np.unique(y)) / len(y)]
    return np.nan_to_num(out)


def by_correlation(record):
    """Name of the candidate that correlates most with the differences of the record."""
    y, T, rate = record["error"], record["temperature"], record["rate"]
    n = len(y)
    candidates = dict(temperature=T, scale_factor=rate, nonlinearity=rate**2,
                      latency=np.gradient(rate), turn_on_transient=np.exp(
                          -np.arange(n) / (n / 20.0)))
    r = {name: abs(np.corrcoef(np.diff(y), np.diff(x))[0, 1])
         for name, x in candidates.items()}
    best = max(r, key=r.get)
    return best if r[best] > 3.5 / np.sqrt(n) else "none"


def by_slopes(record):
    """Ljung-Box on second differences, then a name from the slopes of the Allan
    deviation."""
    y = record["error"]
    tau, adev = sensorid.allan_deviation(y, generator.DT)
    slope = np.diff(np.log(adev)) / np.diff(np.log(tau))
    d = np.diff(y)
    d = (d - d.mean()) / d.std()
    n = len(d)
    q = n * (n + 2) * sum(np.mean(d[k:] * d[:-k])**2 / (n - k) for k in range(2, 22))
    if chi2.sf(q, 20) > 0.01:
        return "none"
    return ("rate_ramp" if slope[-1] > 0.85 else "bandwidth" if slope[0] > -0.4 else
            "correlated_noise")


def forest():
    """A random forest trained on records of the generator, or None without sklearn."""
    try:
        from sklearn.ensemble import RandomForestClassifier
    except ImportError:
        return None
    effects = generator.ADDITIVE + generator.OTHERS
    rng = np.random.default_rng(SEED + 1)
    train = TRAIN if figures.size["trials"] >= 500 else 200
    x, name = [], []
    for k in range(train):
        e = () if rng.random() < 0.25 else (str(rng.choice(effects)),)
        x.append(features(generator.record(SEED + 1, k, e, int(rng.integers(1, 5)))))
        name.append(e[0] if e else "none")
    return RandomForestClassifier(400, random_state=0, n_jobs=-1).fit(x, name)


def compute():
    """Rows (effects, level, truth, report, extras); those made before are kept."""
    figures.OUTPUT.mkdir(exist_ok=True)
    file = figures.OUTPUT / "gap.jsonl"
    kept = {}
    if file.exists():
        for line in file.read_text().splitlines():
            one = json.loads(line)
            kept[one["number"], one["effects"], one["level"]] = one
    model = sensorlab.read_model(withheld.DATA / "model.json")
    rows, listed = [], plan()
    with open(file, "a") as stream:
        for number, effects, level in listed:
            key = number, "+".join(effects) or "none", level
            if key not in kept:
                record = made(number, effects, level)
                columns = {k: record[k] for k in ("temperature", "rate")}
                d = sensorlab.diagnose(record["error"], generator.DT, model.simulator,
                                      columns)
                named = sensorlab.Record("", "error", record["error"], generator.DT)
                extra = dict(correlation=by_correlation(record),
                             slopes=by_slopes(record),
                             features=features(record).tolist())
                if len(effects) == 1 and effects[0] in generator.ADDITIVE:
                    extra["bound"] = bound(record, level,
                                           model.simulator.hypotheses)
                    extra["nats"] = profiled(record,
                                              model.simulator.hypotheses)
                kept[key] = dict(number=number, effects=key[1], level=level,
                                 truth=record["truth"],
                                 report=sensorlab.report(d, named), **extra)
                stream.write(json.dumps(kept[key], default=float) + "\n")
                stream.flush()
            rows.append(kept[key])
            if figures.size["progress"]:
                figures.size["progress"](len(rows), len(listed))
    return rows


def labels(rows):
    """Rows as `withheld.table` takes them."""
    result = []
    for row in rows:
        level = row["level"]
        if "+" in row["effects"]:
            level = withheld.PAIR
        elif row["effects"] in generator.OUTSIDE:
            level = withheld.OUTSIDE
        result.append((row["effects"], level, row["truth"], row["report"]))
    return result


def draw(rows, trees):
    fig, (left, last) = plt.subplots(1, 2, figsize=(11.0, 4.6), width_ratios=(3, 2))
    single = [r for r in rows if r["level"] and "+" not in r["effects"]
              and r["effects"] not in generator.OUTSIDE]
    additive = [r for r in single if "bound" in r]
    levels = [1, 2, 3, 4]
    guess = {id(r): name for r, name in zip(rows, trees.predict(
        [r["features"] for r in rows]))} if trees else {}
    curves = {
        "diagnose, all effects": (single, lambda r: withheld.right(r["effects"],
                                                                   r["report"])),
        "diagnose, additive": (additive, lambda r: withheld.right(r["effects"],
                                                                  r["report"])),
        "Bayes-optimal, additive": (additive, lambda r: r["bound"] == r["effects"]),
        "largest correlation, additive": (additive, lambda r: r["correlation"]
                                          == r["effects"]),
        "Ljung-Box and Allan slopes": (single, lambda r: r["slopes"] == r["effects"])}
    if trees:
        curves["random forest"] = single, lambda r: guess[id(r)] == r["effects"]
    ratio = withheld.ratio(np.array([
        np.mean([r["nats"] for r in additive if r["level"] == k]) for k in levels]))
    for number, (label, (own, hit)) in enumerate(curves.items()):
        hits = [[hit(r) for r in own if r["level"] == k] for k in levels]
        aside = 1.01**(number - 2.5)    # so that no bar hides another
        left.errorbar(aside * ratio, [100.0 * np.mean(h) for h in hits], label=label,
                      color=COLOURS[number], marker="o", capsize=2,
                      yerr=100.0 * np.abs(np.transpose([np.subtract(
                          withheld.interval(sum(h), len(h)), np.mean(h))
                          for h in hits])))
    left.set(xscale="log", ylabel="named rightly, %", ylim=(-3.0, 103.0),
             xlabel="severity: signal-to-noise ratio at a matched filter")
    legend_above(left)
    none = [r for r in rows if r["effects"] == "none"]
    said = {"diagnose": [withheld.false_alarm("none", r["report"]) for r in none],
            "correlation": [r["correlation"] != "none" for r in none],
            "Ljung-Box": [r["slopes"] != "none" for r in none]}
    if trees:
        said["random forest"] = [guess[id(r)] != "none" for r in none]
    for at, hits in enumerate(said.values()):
        last.bar(at, 100.0 * np.mean(hits), color=BEFORE, alpha=0.7)
        last.plot([at, at], 100.0 * np.array(withheld.interval(sum(hits), len(hits))),
                  "-", color=INK)
    last.grid(axis="x", visible=False)
    last.set_xticks(range(len(said)), list(said), rotation=20)
    last.set(ylabel="an effect named, %",
             title=f"{len(none)} records without an effect")
    return fig


def main():
    rows = compute()
    share = np.mean([row["effects"] == "none" for row in withheld.labels()])
    print(withheld.table(labels(rows), share))
    save(draw(rows, forest()), "gap")
