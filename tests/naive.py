"""Slow twins: the paper's equations in plain NumPy, written from the text alone.

Nothing here comes from `sensorid`. States carry the bias, as in Eqs. (21)-(22); every
node has full matrices; every step is taken for every node.
"""

import itertools

import numpy as np


def random_walk(theta, dt, bias_sigma):
    """Phi, Gamma, H, Psi, P0 of Eqs. (21), (23); theta = (sigma_w, sigma_v)."""
    sigma_w, sigma_v = theta
    return (np.eye(2), np.array([[sigma_w], [0.0]]), np.array([[1.0, 1.0]]),
            np.array([[sigma_v]]), np.diag([0.0, bias_sigma**2]))


def markov(theta, dt, bias_sigma):
    """Phi, Gamma, H, Psi, P0 of Eqs. (22), (23); theta = (tau_m, sigma_m, sigma_v)."""
    tau_m, sigma_m, sigma_v = theta
    return (np.diag([np.exp(-dt / tau_m), 1.0]),
            np.array([[sigma_m * np.sqrt(1.0 - np.exp(-2.0 * dt / tau_m))], [0.0]]),
            np.array([[1.0, 1.0]]), np.array([[sigma_v]]),
            np.diag([sigma_m**2, bias_sigma**2]))


class Node:
    """One Kalman filter of the bank."""

    def __init__(self, theta, Phi, Gamma, H, Psi, P0):
        self.theta, self.Phi, self.Gamma, self.H, self.Psi = theta, Phi, Gamma, H, Psi
        self.x, self.P = np.zeros(len(Phi)), P0
        self.log_likelihood = 0.0

    def step(self, y):
        """Eqs. (4)-(9) for one sample; the density of the innovation."""
        x = self.Phi @ self.x
        P = self.Phi @ self.P @ self.Phi.T + self.Gamma @ self.Gamma.T           # (6)
        if np.isnan(y):
            self.x, self.P = x, P
            return 1.0
        Lambda = (self.H @ P @ self.H.T + self.Psi @ self.Psi.T)[0, 0]           # (8)
        nu = y - (self.H @ x)[0]                                                 # (7)
        K = (P @ self.H.T)[:, 0] / Lambda                                        # (5)
        self.x = x + K * nu                                                      # (4)
        self.P = (np.eye(len(x)) - np.outer(K, self.H[0])) @ P
        self.log_likelihood -= 0.5 * (np.log(2 * np.pi * Lambda) + nu**2 / Lambda)
        return np.exp(-0.5 * nu**2 / Lambda) / np.sqrt(2 * np.pi * Lambda)       # (9)


class Identification:
    """The five steps of Sec. 2 for K hypotheses."""

    def __init__(self, banks):
        """banks: for each hypothesis a list of `Node`."""
        self.banks = banks
        self.mu = [np.full(len(nodes), 1.0 / len(nodes)) for nodes in banks]     # (3)
        self.probability = np.full(len(banks), 1.0 / len(banks))

    def step(self, y):
        density = [np.array([node.step(y) for node in nodes]) for nodes in self.banks]
        evidence = np.array([mu @ f for mu, f in zip(self.mu, density)])         # (11)
        joint = evidence * self.probability
        self.probability = joint / joint.sum()                                   # (10)
        self.mu = [mu * f / (mu @ f) for mu, f in zip(self.mu, density)]         # (12)

    def parameters(self, k):
        """Eqs. (13), (14) for theta."""
        theta = np.array([node.theta for node in self.banks[k]])
        mean = self.mu[k] @ theta
        return mean, (np.einsum("j,ja,jb->ab", self.mu[k], theta, theta)
                      - np.outer(mean, mean))

    def state(self, k):
        """Eqs. (13), (14) for x."""
        x = np.array([node.x for node in self.banks[k]])
        P = np.array([node.P for node in self.banks[k]])
        mean = self.mu[k] @ x
        second = np.einsum("j,jab->ab", self.mu[k], P + x[:, :, None] * x[:, None, :])
        return mean, second - np.outer(mean, mean)


def covariance(Phi, Gamma, H, Psi, P0, n):
    """Covariance of y_1 ... y_n by the definition: y is a matrix times all the
    noises, of which Gamma (states, noises) may be another at every sample."""
    states, noises = Gamma.shape[-2:]
    Gamma = np.broadcast_to(Gamma, (n, states, noises))
    rows = np.zeros((n, states + n * noises))
    seen = [H @ np.linalg.matrix_power(Phi, k) for k in range(n + 1)]
    for i in range(n):
        rows[i, :states] = seen[i + 1][0]
        of_each = np.array(seen[i::-1]) @ Gamma[:i + 1]    # i - j ago
        rows[i, states:states + (i + 1) * noises] = of_each.ravel()
    noise = np.eye(states + n * noises)
    noise[:states, :states] = P0
    return rows @ noise @ rows.T + Psi[0, 0]**2 * np.eye(n)


def allan_variance(omega, m):
    """Half the mean square difference of neighbouring cluster means, clusters
    overlapping."""
    means = np.array([np.mean(omega[i:i + m]) for i in range(len(omega) - m + 1)])
    return 0.5 * np.mean((means[m:] - means[:-m])**2)


def histories(begin, end, n):
    """Every history (2^n, n) of a level that is 0 or 1, and its probability; chances
    that 1 begins and ends.
    """
    paths = np.array(list(itertools.product((0, 1), repeat=n)))
    chance = np.array([begin / (begin + end), end / (begin + end)])[paths[:, 0] ^ 1]
    for before, after in zip(paths[:, :-1].T, paths[:, 1:].T):
        leave = np.where(before, end, begin)
        chance = chance * np.where(before == after, 1.0 - leave, leave)
    return paths, chance
