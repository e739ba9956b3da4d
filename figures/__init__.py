"""Figures 1-6 of the paper and our own; `python -m figures` draws them.

Every file has `compute` (no Matplotlib), `draw` (no statistics) and `main`. What they
share stands here: the cases of Sec. 4, the style of the drawings, where they go.
"""

import functools
import json
import pathlib

try:
    import matplotlib

    import sensorid
    from sensorlab.drawings.style import STYLE, with_plain_logs
except KeyboardInterrupt:    # of `python -m figures`, which starts here
    raise SystemExit("figures: interrupted") from None

matplotlib.use("Agg")
matplotlib.rcParams.update({
    **STYLE, "text.parse_math": True, "axes.titleweight": "normal",
    "figure.figsize": (6.4, 4.2), "figure.constrained_layout.use": True,
    "savefig.dpi": 150})

OUTPUT = pathlib.Path(__file__).parent / "output"
COLOURS = "tab:red", "tab:green", "tab:blue", "black", "tab:orange"

SEED = 1997
DURATION = 2000.0    # s, Sec. 4
BIAS_SIGMA = 1.0     # u; not printed in the paper, see the audit figure
# the paper's trials; dt: see the audit
size = dict(trials=500, dt=0.1, progress=None)


def case(number, tau_m=(60.0, 1500.0), bias_sigma=BIAS_SIGMA, markov="markov"):
    """The two hypotheses of Sec. 4 in case 1 (no white noise), 2 (known) or 3
    (unknown)."""
    white = {1: {}, 2: {"sigma_v": 0.5}, 3: {"sigma_v": (0.25, 1.0)}}[number]
    return (
        sensorid.hypothesis("random_walk", bias_sigma=bias_sigma, sigma_w=(0.04, 0.15),
                            **white),
        sensorid.hypothesis(markov, name="markov", bias_sigma=bias_sigma, tau_m=tau_m,
                            sigma_m=(0.5, 1.5), **white))


@functools.cache
def _criteria(number, trials, dt):
    return sensorid.criteria(case(number), dt, DURATION, trials, SEED,
                             progress=size["progress"])


def case_criteria(number):
    """Criteria of a case at the current size, computed once."""
    return _criteria(number, size["trials"], size["dt"])


def curve(criteria, label):
    """The RSD of one parameter, such as markov.tau_m."""
    return criteria.rsd[criteria.labels.index(label)]


def draw_pair(ax, time, c, colour, label):
    """A criterion as the paper draws it: real solid, calculated dashed; shaded +- 1
    s.e."""
    ax.plot(time, c.real, "-", color=colour, label=f"{label}, real")
    ax.plot(time, c.calculated, "--", color=colour, label=f"{label}, calculated")
    ax.fill_between(time, c.real - c.real_se, c.real + c.real_se, color=colour,
                    alpha=0.15, linewidth=0)


def kept(name):
    """Results of an earlier run by key, and the function that keeps one more."""
    OUTPUT.mkdir(exist_ok=True)
    file, result = OUTPUT / f"{name}.jsonl", {}
    if file.exists():
        for line in file.read_text().splitlines():
            result.update([json.loads(line)])

    def keep(key, value):
        with open(file, "a") as stream:
            stream.write(json.dumps([key, value]) + "\n")
        result[key] = value
    return result, keep


def repeated(name, kinds, repeats, verdict):
    """{kind: [verdict, ...]} of so many records of every kind, one in a small version,
    of which `verdict` (kind, number) gives one; those given before are kept.
    """
    known, keep = kept(name)
    result = {}
    for done, kind in enumerate(kinds, 1):
        for number in range(repeats if size["trials"] >= 500 else 1):
            key = f"{kind} {number}"
            if key not in known:
                keep(key, verdict(kind, number))
            result.setdefault(kind, []).append(known[key])
        if size["progress"]:
            size["progress"](done, len(kinds))
    return result


def save(fig, name):
    """PNG and PDF."""
    import matplotlib.pyplot as plt
    OUTPUT.mkdir(exist_ok=True)
    with_plain_logs(fig)
    for kind in ("png", "pdf"):
        fig.savefig(OUTPUT / f"{name}.{kind}")
    plt.close(fig)
