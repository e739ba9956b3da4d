"""Figure 1. Case 1, no white noise. (a) Probability of the identification error; (b)
Allan deviations of one sample of 2000 s for each of five models, with their
expectations."""

from figures import identification

EXAMPLES = [
    ("random_walk", dict(sigma_w=0.04)),
    ("random_walk", dict(sigma_w=0.15)),
    ("markov", dict(tau_m=60.0, sigma_m=0.5)),
    ("markov", dict(tau_m=300.0, sigma_m=1.0)),
    ("markov", dict(tau_m=1500.0, sigma_m=1.5)),
]


def main():
    identification.run(1, "Without white noise", EXAMPLES)
