#!/usr/bin/env python3
"""Bytes and error of csbrdf beside general compressors of arrays (SPERR, SZ3, zfp), on the same tables in one run.

usage: tools/peers/peers.py TABLE.binary... --out DIR [--peers-from CSV] [--csbrdf TOOL] [--csbrdf-options "OPTIONS"]

Needs `pip install -r tools/peers/requirements.txt` and a built csbrdf. Writes DIR/points.csv (every point measured),
DIR/rate-distortion.svg and .png; prints Markdown tables, progress on standard error. What each codec was given is said
in README.md beside this file. With --peers-from an earlier points.csv only csbrdf is measured; tables are matched by the
CRC of their files.
"""
import os

for threads in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ[threads] = '1'

import argparse
import sys
import tempfile
import time

import coders
import curves
import plot
from tables import Table, fill, mask_bytes

MISSING = ('Not measured: tthresh (no package for Python; the one of PyPI for WebAssembly, numcodecs-wasm-tthresh 0.3.2, '
           'cannot decode tables of this size).')


def labels(paths):
    """The files' stems, with the folder's name before those that occur twice."""
    stems = [os.path.splitext(os.path.basename(path))[0] for path in paths]
    folder = lambda path: os.path.basename(os.path.dirname(os.path.abspath(path)))
    return [f'{folder(path)}/{stem}' if stems.count(stem) > 1 else stem for path, stem in zip(paths, stems)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('table', nargs='+', help='MERL .binary files')
    parser.add_argument('--out', required=True, help='folder for points.csv and the figure')
    parser.add_argument('--csbrdf', default='target/release/csbrdf', help='the program')
    parser.add_argument('--csbrdf-options', default='', metavar='OPTIONS', help='more options for `csbrdf encode`, quoted')
    parser.add_argument('--csbrdf-fast', metavar='OPTIONS', help='adds a second curve of csbrdf, with these options')
    parser.add_argument('--peers-from', metavar='CSV', help="the peers' points of an earlier run")
    parser.add_argument('--csbrdf-from', metavar='CSV', help="csbrdf's points of an earlier run too")
    parser.add_argument('--only', choices=('peers', 'csbrdf'), help='measure no others')
    arguments = parser.parse_args()
    os.makedirs(arguments.out, exist_ok=True)
    store = os.path.join(arguments.out, 'points.csv')

    stored = []
    if arguments.peers_from:
        stored += [p for p in curves.read_csv(arguments.peers_from) if curves.is_peer(p['codec'])]
    if arguments.csbrdf_from:
        stored += [p for p in curves.read_csv(arguments.csbrdf_from) if not curves.is_peer(p['codec'])]
    known = {(p['crc32'], p['codec']) for p in stored}
    own = [] if arguments.only == 'peers' else [('csbrdf', arguments.csbrdf_options)]
    if own and arguments.csbrdf_fast is not None:
        own.append(('csbrdf-fast', arguments.csbrdf_fast))
    peers = [] if arguments.only == 'csbrdf' else [codec() for codec in coders.PEERS]

    measured, points = [], []
    for path, label in zip(arguments.table, labels(arguments.table)):
        begin = time.monotonic()
        table = Table(path, label)
        points += [{**p, 'table': label} for p in stored if p['crc32'] == table.crc32]
        wanted = [codec for codec in peers if (table.crc32, codec.name) not in known]
        if wanted:
            filled, mask = fill(table.log, table.valid), mask_bytes(table.valid)
            for codec in wanted:
                points += coders.measure_peer(codec, table, filled, mask, curves.LEVELS)
        for name, options in own:
            if (table.crc32, name) not in known:
                with tempfile.TemporaryDirectory() as folder:
                    points += coders.measure_csbrdf(name, arguments.csbrdf, options, table, folder, curves.LEVELS)
        curves.write_csv(store, points)
        table.release()
        measured.append(table)
        print(f'{label}: noise {table.sigma:.5f}, {time.monotonic() - begin:.0f} s', file=sys.stderr)

    found = curves.by_table(points, measured)
    plot.draw(found, measured, arguments.out)
    print(curves.markdown(found, measured))
    print(MISSING)


if __name__ == '__main__':
    main()
