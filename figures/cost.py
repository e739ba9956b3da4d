"""Cost. Error of the answer against the filter updates it takes, case 3 after 200 s:
the uniform grid of the paper, our fixed grid (logarithmic, the scale of the noises
integrated in closed form), and the grid that zooms in on every record. Errors are rms
differences, over the trials, from a fixed grid of 120 nodes an axis; the dotted line is
1 % of the updates of a uniform grid of 100 nodes an axis."""

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid

DURATION = 200.0    # s
UNIFORM = 3, 4, 6, 8, 12, 16, 24, 32    # nodes an axis
FIXED = 3, 4, 6, 8, 10, 12, 16, 24, 32
REFERENCE = 120


def _answers(grids, y):
    """Probabilities (C, K), then means and sds (C, P) of all parameters."""
    evidence, mean, sd = [], [], []
    for g in grids:
        e, m, cov = next(sensorid.posteriors(g, y, [y.shape[1]]))
        evidence.append(e)
        mean.append(m)
        sd.append(np.sqrt(np.diagonal(cov, axis1=1, axis2=2)))
    return (sensorid.probabilities(np.stack(evidence, 1)), np.concatenate(mean, 1),
            np.concatenate(sd, 1))


def _errors(answer, reference, own):
    """Rms error of the probability, and of the means of the true hypothesis in sds."""
    (probability, mean, _), (true_probability, true_mean, sd) = answer, reference
    return (np.sqrt(np.mean((probability - true_probability)**2)),
            np.sqrt(np.mean((((mean - true_mean) / sd)[own])**2)))


def compute(trials=32):
    """For each method rows of (updates a record, error of Pr, error of the means)."""
    dt = figures.size["dt"]
    H = figures.case(3)
    T = sensorid.simulate(H, dt, round(DURATION / dt), trials, figures.SEED)
    y, N = T.error, T.error.shape[1]
    own = T.hypothesis[:, None] == np.repeat([0, 1], [len(h.parameters) for h in H])
    reference = _answers([sensorid.grid(h, dt, REFERENCE) for h in H], y)

    def rows(make, counts):
        result = []
        for count in counts:
            grids = [make(h, dt, count) for h in H]
            updates = N * sum(len(g.theta) for g in grids)
            result.append((updates, *_errors(_answers(grids, y), reference,
                                            own)))
        return np.array(result)

    answers = [sensorid.identify(record, dt, H) for record in y]
    means = [np.concatenate([e.mean for e in a.estimates]) for a in answers]
    zoomed = np.array([a.probability for a in answers]), np.array(means), None
    updates = np.mean([sum(e.updates for e in a.estimates) for a in answers])
    return dict(uniform=rows(sensorid.uniform_grid, UNIFORM),
                fixed=rows(sensorid.grid, FIXED),
                zoom=np.array([(updates, *_errors(zoomed, reference, own))]),
                limit=0.01 * N * (100**2 + 100**3))


def draw(uniform, fixed, zoom, limit):
    fig, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), sharex=True)
    names = "rms error of the probabilities", "rms error of the means, posterior sd"
    for column, (ax, name) in enumerate(zip(axes, names), 1):
        for colour, style, label, rows in (
                ("tab:red", "s-", "uniform grid", uniform),
                ("tab:green", "o-", "fixed grid, scale in closed form", fixed),
                ("tab:blue", "D", "zoom on every record", zoom)):
            ax.loglog(rows[:, 0], rows[:, column], style, color=colour, label=label)
        ax.axvline(limit, color="0.5", linestyle=":", label="1 % of 100 nodes an axis")
        ax.set(xlabel="filter updates a record", ylabel=name)
    axes[0].legend(fontsize="small")
    return fig


def main():
    result = compute()
    for method, rows in result.items():
        for updates, probability, mean in rows if method != "limit" else ():
            print(f"{method:<8}{updates:>10.3g} updates: error of the probability "
                  f"{probability:.2g}, of the means {mean:.2g} sd")
    figures.save(draw(**result), "cost")
