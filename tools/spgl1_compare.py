#!/usr/bin/env python3
"""Speed and norms of the encoder's solver beside the PyPI package `spgl1`, on the same blocks in one run, one thread.

usage: spgl1_compare.py TABLE.binary [--blocks N] [--gap G] [--seed S]

Needs numpy, scipy, spgl1==0.0.3 and `cargo build --release --example spgl1_compare`. Blocks of 15 x 15 x 15 of ln(f +
1e-3), drawn among those with valid entries in a fixed order, full and with holes in turn, are point-sampled at 1, 5 and
25 % of their valid entries, the mean of the samples taken off, and recovered in the DCT and in the DFT basis to an rms
residual of sigma = 1e-3:

    min ||s||_1   subject to   ||y - A s||_2 <= sigma sqrt(m).

The operator is what numpy has to offer: scipy.fft, one worker; for the DFT rfftn, the half of the spectrum of a real
block, with weights sqrt 2 where it stands for two coefficients. First the package solves at its default tolerances;
its residual is then the sigma of this solver, so that norms compare at equal residual.
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import numpy as np
import scipy.fft
import spgl1
from scipy.sparse.linalg import LinearOperator

N = 15
SHAPE = (N, N, N)
SCALE = (1 / 1500, 1.15 / 1500, 1.66 / 1500)
SIGMA = 1e-3
HERE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def load(path):
    with open(path, "rb") as file:
        shape = np.fromfile(file, "<i4", 3)
        values = np.fromfile(file, "<f8").reshape(3, *shape)
    valid = values[0] >= 0
    return np.log(np.maximum(values[1], 0) * SCALE[1] + 1e-3), valid


def blocks(table, valid, count, rng):
    """(values, valid) of blocks, full ones and such with holes in turn as far as there are both."""
    corners = [(i, j, k) for i in range(0, 90, N) for j in range(0, 90, N) for k in range(0, 180, N)]
    full, holes = [], []
    for n in rng.permutation(len(corners)):
        at = tuple(slice(c, c + N) for c in corners[n])
        share = valid[at].mean()
        if share == 1:
            full.append(at)
        elif share > 0.2:
            holes.append(at)
    order = [at for pair in zip(full, holes) for at in pair]
    return [(table[at].ravel(), valid[at].ravel()) for at in order[:count]]


def operator(basis, positions):
    """The linear operator, and the weights of its coefficients."""
    grid = np.zeros(N**3)

    if basis == "dct":
        def forward(s):
            return scipy.fft.idctn(s.reshape(SHAPE), norm="ortho", workers=1).ravel()[positions]

        def adjoint(y):
            grid[positions] = y.ravel()
            return scipy.fft.dctn(grid.reshape(SHAPE), norm="ortho", workers=1).ravel()

        return LinearOperator((len(positions), N**3), matvec=forward, rmatvec=adjoint, dtype=float), 1

    half = (N, N, N // 2 + 1)
    scale = np.full(half, np.sqrt(2.0))
    scale[..., 0] = 1

    def forward(s):
        return scipy.fft.irfftn(s.reshape(half) / scale, SHAPE, norm="ortho", workers=1).ravel()[positions]

    def adjoint(y):
        grid[positions] = np.real(y.ravel())
        return (scipy.fft.rfftn(grid.reshape(SHAPE), norm="ortho", workers=1) * scale).ravel()

    return LinearOperator((len(positions), scale.size), matvec=forward, rmatvec=adjoint, dtype=complex), scale.ravel()


def quantiles(values, form=".3g"):
    return "{:{f}} ({:{f}}, {:{f}})".format(*np.quantile(values, (0.5, 0.1, 0.9)), f=form)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("table")
    parser.add_argument("--blocks", type=int, default=10, help="blocks of each kind of problem; 6 kinds")
    parser.add_argument("--gap", default="inf", help="duality gap asked of this solver; inf: the first point at sigma")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    table, valid = load(args.table)
    chosen = blocks(table, valid, args.blocks, rng)

    kinds, theirs, lines = [], [], []
    for basis in ("dct", "dft"):
        for ratio in (0.01, 0.05, 0.25):
            for number, (values, usable) in enumerate(chosen):
                positions = np.flatnonzero(usable & (rng.random(N**3) < ratio))
                y = values[positions] - values[positions].mean()
                length = np.linalg.norm(y)
                sigma = SIGMA * np.sqrt(len(y))
                if sigma >= length:
                    continue
                a, weights = operator(basis, positions)
                begin = time.thread_time()
                # Its tolerances are partly absolute: the samples are normalised, as this solver does by itself.
                s, r, _, info = spgl1.spg_bpdn(a, y / length, sigma / length, iter_lim=10000, weights=weights)
                seconds = time.thread_time() - begin
                norm, residual = np.sum(np.abs(s) * weights) * length, np.linalg.norm(r) * length
                kinds.append((basis, ratio, "holes" if number % 2 else "full"))
                theirs.append((norm, residual, info["niters"], info["nprodA"] + info["nprodAt"], seconds, sigma))
                samples = " ".join(f"{p}:{float(v)!r}" for p, v in zip(positions, y))
                lines.append(f"{basis} {residual!r} {args.gap} {samples}")
        print(f"{basis}: solved by spgl1", file=sys.stderr)

    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(line.replace("np.float64(", "").replace(")", "") for line in lines))
        file.flush()
        program = os.path.join(HERE, "target", "release", "examples", "spgl1_compare")
        output = subprocess.run([program, file.name], check=True, capture_output=True, text=True).stdout
    ours = [line.split() for line in output.splitlines()]

    print("| problems | count | norm / spgl1's | residual / spgl1's | spgl1 steps, transforms, ms | here steps, transforms, ms | times faster: median (10 %, 90 %) |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    rows = {}
    for kind, old, new in zip(kinds, theirs, ours):
        for key in (f"{kind[0]}, {kind[1]:.0%}", "full blocks" if kind[2] == "full" else "blocks with holes", "all"):
            rows.setdefault(key, []).append((old, new))
    for key in sorted(rows, key=lambda k: (k == "all", "block" in k, k)):
        pairs = rows[key]
        column = lambda side, i: np.array([float(pair[side][i]) for pair in pairs])
        print(
            f"| {key} | {len(pairs)}",
            quantiles(column(1, 0) / column(0, 0), ".4f"),
            quantiles(column(1, 1) / column(0, 1), ".4f"),
            f"{np.median(column(0, 2)):.0f}, {np.median(column(0, 3)):.0f}, {1e3 * np.median(column(0, 4)):.1f}",
            f"{np.median(column(1, 3)):.0f}, {np.median(column(1, 4)):.0f}, {1e3 * np.median(column(1, 5)):.2f}",
            quantiles(column(0, 4) / column(1, 5)) + " |",
            sep=" | ",
        )


if __name__ == "__main__":
    main()
