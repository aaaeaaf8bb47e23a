"""Seconds that decoding takes: csbrdf beside SZ3 and zfp at the same log error, and beside reading the raw table. One thread, one
process, one after the other and again: medians, and each one's median ratio to the raw table of its own round.

usage: decode.py TABLE.binary=FILE.csbrdf... (the file encoded from the table), with the csbrdf package of tools/python installed
"""
import os

os.environ['RAYON_NUM_THREADS'] = '1'

import sys
import time

import csbrdf
import numpy as np

import coders
import tables

ROUNDS = 15
SCALES = np.float32([[1.0 / 1500], [1.15 / 1500], [1.66 / 1500]])


def raw(path):
    """A MERL table as float32 in 1/sr, from the page cache."""
    values = np.fromfile(path, '<f8', offset=12).astype(np.float32)
    values.reshape(3, -1)[...] *= SCALES
    return values


def at_error(codec, table, filled, rms, variant):
    """Streams at a log rms: the setting that gives it, by halving in the logarithm."""
    planes = np.ascontiguousarray(np.tensordot(coders.OPPONENT, filled, 1), dtype=np.float32)

    def measure(setting):
        streams = codec.encode(planes, setting, variant)
        decoded = np.tensordot(coders.OPPONENT.T, np.stack(codec.decode(streams, table.valid.shape, variant)), 1)
        return streams, tables.log_error(table.log, decoded, table.valid)[0]

    low, high = 1e-4, 10.0
    for _ in range(14):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if measure(middle)[1] > rms else (middle, high)
    return measure(low)


def values_of(codec, streams, shape, variant):
    """From streams to BRDF values."""
    log = np.tensordot(coders.OPPONENT.T.astype(np.float32), np.stack(codec.decode(streams, shape, variant)), 1)
    return np.maximum(np.exp(log, out=log) - np.float32(tables.EPS), 0, out=log)


def seconds(calls):
    """Times of all calls, round by round."""
    times = {name: [] for name in calls}
    for _ in range(ROUNDS + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begin)
    # The first round warms up.
    return {name: np.array(of_name[1:]) for name, of_name in times.items()}


def main(arguments):
    print('| table | log rms | what | kB | ms | by raw | ms to log values alone |')
    print('| --- | --- | --- | --- | --- | --- | --- |')
    for argument in arguments:
        path, file = argument.split('=')
        table = tables.Table(path, os.path.basename(path))
        filled = tables.fill(table.log, table.valid)
        shape = table.valid.shape
        with open(file, 'rb') as opened:
            data = opened.read()
        decoded = csbrdf.Brdf(data).decode().astype('f8').reshape(3, *shape)
        rms = tables.log_error(table.log, np.log(decoded + tables.EPS), table.valid)[0]
        calls = {'raw': lambda path=path: raw(path), 'csbrdf': lambda data=data: csbrdf.Brdf(data).decode()}
        sizes, errors = {'raw': os.path.getsize(path), 'csbrdf': len(data)}, {'raw': 0.0, 'csbrdf': rms}
        for codec, variant in ((coders.Sz3(), 'interp-lorenzo'), (coders.Zfp(), 'accuracy')):
            streams, errors[codec.name] = at_error(codec, table, filled, rms, variant)
            sizes[codec.name] = sum(map(len, streams))
            calls[codec.name] = lambda c=codec, s=streams, v=variant: values_of(c, s, shape, v)
            calls[codec.name + ' log'] = lambda c=codec, s=streams, v=variant: c.decode(s, shape, v)
        times = seconds(calls)
        for name, size in sizes.items():
            log = times.get(name + ' log')
            alone = '' if log is None else f'{1e3 * np.median(log):.1f}'
            print(f'| {table.label} | {errors[name]:.5f} | {name} | {size / 1e3:.1f} | {1e3 * np.median(times[name]):.1f} '
                  f'| {np.median(times[name] / times["raw"]):.2f} | {alone} |', flush=True)


if __name__ == '__main__':
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1:])
