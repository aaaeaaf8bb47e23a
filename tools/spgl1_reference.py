"""Reference results of the PyPI package `spgl1` for the solver's agreement test.

Usage, from the repository's root (Python 3.10 or later):

    pip install numpy scipy spgl1==0.0.3
    python tools/spgl1_reference.py > tests/data/spgl1_reference.txt

Every problem is a 15 x 15 x 15 block of a formula, with noise or spikes from a 64-bit linear congruential generator,
point-sampled by the same generator, to be recovered in an orthonormal basis:

    min sum w_i |s_i|   subject to   ||y - A s||_2 <= sigma,   sigma = factor * ||y||_2

`src/solve/agreement.rs` builds the same problems from the same formulas; no numpy generator is involved. Columns:

    basis    dct (DCT-II), dft (complex magnitudes), or mmv: the DCT of three channels that share their support,
             sum_k w_k ||(s_k1, s_k2, s_k3)||_2, by spg_mmv
    block    smooth, noisy (uniform noise of width 1), spiky (60 spikes within +-10) or stiff (two levels, 23 apart)
    holes    full, or holes: no sample where the indices i + j are above 18
    ratio    Bernoulli sampling ratio
    factor   sigma / ||y||; 0 is basis pursuit
    weights  plain (all 1) or frequency (1 + |k|)
    rows     number of samples of a channel, to see that both sides drew the same
    y_norm   ||y||_2, likewise
    l1       ||W s||_1 of the reference, converged far beyond the tolerance of the test
    residual ||y - A s||_2 of the reference
    iterations, transforms   of the reference at its default tolerances (opt_tol 1e-4 and bp_tol 1e-6,
                             both of ||y||: the samples are normalised)
"""

from importlib.metadata import version

import numpy as np
import scipy
import spgl1
from scipy import fft
from scipy.sparse.linalg import LinearOperator

N = 15
PROBLEMS = [
    # basis, block, holes, ratio, factor, weights
    ("dct", "smooth", "full", 0.01, 1e-2, "plain"),
    ("dct", "smooth", "full", 0.05, 1e-2, "plain"),
    ("dct", "smooth", "full", 0.20, 1e-3, "frequency"),
    ("dct", "smooth", "full", 0.50, 0.0, "plain"),
    ("dct", "spiky", "full", 0.05, 5e-2, "frequency"),
    ("dct", "spiky", "full", 0.20, 1e-2, "plain"),
    ("dct", "spiky", "full", 0.50, 1e-2, "frequency"),
    ("dct", "noisy", "full", 0.05, 0.0, "plain"),
    ("dct", "noisy", "full", 0.20, 2e-2, "plain"),
    ("dct", "noisy", "full", 0.50, 1e-2, "frequency"),
    ("dct", "smooth", "holes", 0.05, 1e-3, "plain"),
    ("dct", "stiff", "holes", 0.10, 1e-2, "plain"),
    ("dft", "smooth", "full", 0.01, 1e-2, "plain"),
    ("dft", "smooth", "full", 0.05, 1e-2, "plain"),
    ("dft", "noisy", "holes", 0.05, 1e-2, "plain"),
    ("dft", "stiff", "full", 0.25, 1e-2, "plain"),
    ("dft", "spiky", "holes", 0.50, 1e-2, "plain"),
    ("mmv", "smooth", "full", 0.01, 1e-2, "plain"),
    ("mmv", "spiky", "full", 0.05, 1e-2, "plain"),
    ("mmv", "noisy", "holes", 0.25, 1e-2, "plain"),
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
    elif kind == "stiff":
        values = np.where((3 * i + 2 * j + k) * 14 > 42, 11.5, -11.5) + 0.1 * values
    return values


def channels(values):
    """The block as three channels of unlike content."""
    p = np.arange(N**3)
    return np.stack([values, values + 0.5 * (p // 225) / 14.0, 0.5 * values + (p % 15) / 14.0], axis=1)


def problem(basis, kind, holes, ratio, weights):
    """Operator, samples `[sample][channel]`, weights, and the norm by those weights."""
    rng = Lcg(1)
    values = block(kind, rng)
    p = np.arange(N**3)
    inside = (p // 225 + p // 15 % 15 <= 18) if holes == "holes" else np.ones(N**3, bool)
    positions = np.array([at for at in p if rng.uniform() < ratio and inside[at]])
    frequency = 1.0 + np.sqrt((p // 225) ** 2 + (p // 15 % 15) ** 2 + (p % 15) ** 2)
    w = frequency if weights == "frequency" else np.ones(N**3)
    y = channels(values)[positions] if basis == "mmv" else values[positions, None]
    grid = np.zeros(N**3)

    def scattered(y):
        grid[positions] = np.real(y.ravel())
        return grid.reshape(N, N, N)

    if basis == "dft":
        # Half of the spectrum, the coefficients that stand for two scaled by sqrt 2.
        half = np.full((N, N, N // 2 + 1), np.sqrt(2.0))
        half[..., 0] = 1.0
        a = LinearOperator(
            (len(positions), half.size),
            matvec=lambda s: fft.irfftn(s.reshape(half.shape) / half, (N, N, N), norm="ortho").ravel()[positions],
            rmatvec=lambda y: (fft.rfftn(scattered(y), norm="ortho") * half).ravel(),
            dtype=complex,
        )
        return a, y, half.ravel()
    a = LinearOperator(
        (len(positions), N**3),
        matvec=lambda s: fft.idctn(s.reshape(N, N, N), norm="ortho").ravel()[positions],
        rmatvec=lambda y: fft.dctn(scattered(y), norm="ortho").ravel(),
        dtype=float,
    )
    return a, y, w


def solve(basis, a, y, factor, w, **options):
    """Norm and norm of the residual for samples of unit norm, and the solver's account of it."""
    if basis == "mmv":
        s, r, _, info = spgl1.spg_mmv(a, y, factor, iter_lim=20000, **options)
        magnitudes = np.linalg.norm(s.reshape(N**3, y.shape[1]), axis=1)
    else:
        s, r, _, info = spgl1.spg_bpdn(a, y[:, 0], factor, iter_lim=20000, weights=w, **options)
        magnitudes = np.abs(s)
    return np.sum(w * magnitudes), np.linalg.norm(r), info


def main():
    print("# made by: python tools/spgl1_reference.py > tests/data/spgl1_reference.txt")
    print(f"# spgl1 {version('spgl1')}, numpy {np.__version__}, scipy {scipy.__version__}")
    print("# basis block holes ratio factor weights rows y_norm l1 residual iterations transforms")
    for basis, kind, holes, ratio, factor, weights in PROBLEMS:
        a, y, w = problem(basis, kind, holes, ratio, weights)
        scale = np.linalg.norm(y)
        y = y / scale  # spgl1's tolerances are partly absolute
        _, _, usual = solve(basis, a, y, factor, w)
        tight = dict(opt_tol=1e-8, bp_tol=1e-6, dec_tol=1e-5, n_prev_vals=10)
        try:
            l1, residual, _ = solve(basis, a, y, factor, w, **tight)
        except IndexError:  # its record of the norms overflows at the iteration limit
            l1, residual, _ = solve(basis, a, y, factor, w, opt_tol=1e-6, bp_tol=1e-6, dec_tol=1e-4)
        transforms = usual["nprodA"] + usual["nprodAt"]
        print(
            f"{basis} {kind} {holes} {ratio} {factor} {weights} {len(y)} {scale:.12g} {l1 * scale:.8g}",
            f"{residual * scale:.8g}",
            usual["niters"],
            transforms,
            flush=True,
        )


if __name__ == "__main__":
    main()
