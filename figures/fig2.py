"""Figure 2. Case 2, white noise known. (a) Probability of the identification error; (b)
Allan deviations of one sample of 2000 s for each of five models, with their
expectations."""

from figures import fig1, identification

EXAMPLES = [(model, dict(parameters, sigma_v=0.5))
            for model, parameters in fig1.EXAMPLES]


def main():
    identification.run(2, r"White noise known, $\sigma_v$ = 0.5 u", EXAMPLES)
