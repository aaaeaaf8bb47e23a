"""Makes the files of run.sh's picture: a golden file's table, stretched to MERL's grid, as a MERL .binary table.

    make_table.py GOLDEN.csbrdf OUT.binary
"""
import sys

import csbrdf
import csbrdf_mitsuba
import numpy as np


def main(golden, out):
    brdf = csbrdf.open(golden)
    table = brdf.decode().astype(np.float64)
    theta_h, theta_d, phi_d = brdf.axes
    square = np.sqrt if theta_h.mapping == "square" else lambda t: t
    where = [square(((np.arange(90) + 0.5) / 90) ** 2), (np.arange(90) + 0.5) / 90, (np.arange(180) + 0.5) / 180]
    for axis, (t, grid) in enumerate(zip(where, brdf.axes), start=1):
        u = t * grid.len - 0.5
        low = np.floor(u).astype(int)
        weight = (u - low).reshape([-1 if k == axis else 1 for k in range(4)])
        index = [(i % grid.len) if axis == 3 else np.clip(i, 0, grid.len - 1) for i in (low, low + 1)]
        table = np.take(table, index[0], axis) * (1 - weight) + np.take(table, index[1], axis) * weight
    with open(out, "wb") as f:
        f.write(np.array([90, 90, 180], "<i4").tobytes())
        for plane, scale in zip(table, csbrdf_mitsuba.MERL_SCALE):
            f.write((plane / scale).astype("<f8").tobytes())


if __name__ == "__main__":
    main(*sys.argv[1:])
