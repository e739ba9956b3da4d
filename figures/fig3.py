"""Figure 3. Case 3, white noise unknown. (a) Probability of the identification error;
(b) Allan deviations of one sample of 2000 s for each of four models, with their
expectations."""

from figures import identification

EXAMPLES = [
    ("random_walk", dict(sigma_w=0.04, sigma_v=0.5)),
    ("random_walk", dict(sigma_w=0.15, sigma_v=1.0)),
    ("markov", dict(tau_m=60.0, sigma_m=0.5, sigma_v=0.5)),
    ("markov", dict(tau_m=1500.0, sigma_m=1.5, sigma_v=1.0)),
]


def main():
    identification.run(3, r"White noise unknown, $\sigma_v \in$ [0.25, 1] u", EXAMPLES)
