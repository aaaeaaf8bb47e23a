"""Reference results of the PyPI package `spgl1` for the solver's agreement test.

Usage, from the repository's root (Python 3.10 or later):

    pip install numpy spgl1==0.0.3
    python tools/spgl1_reference.py > tests/data/spgl1_reference.txt

Every problem is a 15 x 15 x 15 block of a formula, with noise or spikes from a 64-bit linear congruential generator,
point-sampled by the same generator, to be recovered in the orthonormal DCT-II basis:

    min sum w_i |s_i|   subject to   ||y - A s||_2 <= sigma,   sigma = factor * ||y||_2

`src/solve/agreement.rs` builds the same problems from the same formulas; no numpy generator is involved. Columns:

    block    smooth, noisy (uniform noise of width 1) or spiky (60 spikes within +-10)
    ratio    Bernoulli sampling ratio
    factor   sigma / ||y||; 0 is basis pursuit
    weights  plain (all 1) or frequency (1 + |k|)
    rows     number of samples, to see that both sides drew the same
    y_norm   ||y||_2, likewise
    l1       ||W s||_1 of the reference, converged far beyond the tolerance of the test
    residual ||y - A s||_2 of the reference
    iterations, transforms   of the reference at its default tolerances (opt_tol 1e-4 and bp_tol 1e-6,
                             both of ||y||: the samples are normalised)
"""

from importlib.metadata import version

import numpy as np
import spgl1
from scipy.sparse.linalg import LinearOperator

N = 15
PROBLEMS = [
    # block, ratio, factor, weights
    ("smooth", 0.05, 1e-2, "plain"),
    ("smooth", 0.20, 1e-3, "frequency"),
    ("smooth", 0.50, 0.0, "plain"),
    ("spiky", 0.05, 5e-2, "frequency"),
    ("spiky", 0.20, 1e-2, "plain"),
    ("spiky", 0.50, 1e-2, "frequency"),
    ("noisy", 0.05, 0.0, "plain"),
    ("noisy", 0.20, 2e-2, "plain"),
    ("noisy", 0.50, 1e-2, "frequency"),
]


class Lcg:
    """Knuth's 64-bit linear congruential generator, uniform in [0, 1) from the upper 53 bits."""

    def __init__(self, seed):
        self.state = seed

    def uniform(self):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (self.state >> 11) / 2.0**53


def block(kind, rng):
    p = np.arange(N**3)
    i, j, k = (p // 225) / 14.0, (p // 15 % 15) / 14.0, (p % 15) / 14.0
    lobe = 1.0 / (0.05 + i * i + 0.3 * (j - 0.4) * (j - 0.4))
    values = lobe + 2.0 * j * k - 3.0 * k * k * (1.0 - k) + 1.0
    if kind == "noisy":
        values += np.array([rng.uniform() - 0.5 for _ in p])
    elif kind == "spiky":
        for _ in range(60):
            at = int(rng.uniform() * 3375.0)
            values[at] += 20.0 * (rng.uniform() - 0.5)
    return values


def problem(kind, ratio, weights):
    rng = Lcg(1)
    values = block(kind, rng)
    positions = np.array([p for p in range(N**3) if rng.uniform() < ratio])
    k, i = np.arange(N)[:, None], np.arange(N)[None, :]
    dct = np.where(k == 0, np.sqrt(1 / N), np.sqrt(2 / N)) * np.cos(np.pi * (2 * i + 1) * k / (2 * N))

    def forward(s):
        return np.einsum("abc,ai,bj,ck->ijk", s.reshape(N, N, N), dct, dct, dct, optimize=True).ravel()[positions]

    def adjoint(y):
        grid = np.zeros(N**3)
        grid[positions] = y.ravel()
        return np.einsum("ijk,ai,bj,ck->abc", grid.reshape(N, N, N), dct, dct, dct, optimize=True).ravel()

    a = LinearOperator((len(positions), N**3), matvec=forward, rmatvec=adjoint, dtype=float)
    q = np.arange(N**3)
    frequency = 1.0 + np.sqrt((q // 225) ** 2 + (q // 15 % 15) ** 2 + (q % 15) ** 2)
    return a, values[positions], frequency if weights == "frequency" else np.ones(N**3)


def main():
    print("# made by: python tools/spgl1_reference.py > tests/data/spgl1_reference.txt")
    print(f"# spgl1 {version('spgl1')}, numpy {np.__version__}")
    print("# block ratio factor weights rows y_norm l1 residual iterations transforms")
    for kind, ratio, factor, weights in PROBLEMS:
        a, y, w = problem(kind, ratio, weights)
        scale = np.linalg.norm(y)
        y = y / scale  # spgl1's tolerances are partly absolute
        _, _, _, usual = spgl1.spg_bpdn(a, y, factor, iter_lim=100000, weights=w)
        tight = dict(opt_tol=1e-8, bp_tol=1e-6, dec_tol=1e-5, n_prev_vals=10)
        s, r, _, _ = spgl1.spg_bpdn(a, y, factor, iter_lim=100000, weights=w, **tight)
        l1, residual = np.sum(w * np.abs(s)), np.linalg.norm(r)
        transforms = usual["nprodA"] + usual["nprodAt"]
        print(
            f"{kind} {ratio} {factor} {weights} {len(y)} {scale:.12g} {l1 * scale:.8g} {residual * scale:.8g}",
            usual["niters"],
            transforms,
        )


if __name__ == "__main__":
    main()
