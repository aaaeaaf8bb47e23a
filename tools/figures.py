#!/usr/bin/env python3
"""Measure the tool on MERL tables: size, error, seconds and peak memory of each encode, then of a block decode.

usage: tools/figures.py [--out DIR] [--encode "OPTIONS"] TABLE.binary...

Runs target/release/csbrdf (build it first: cargo build --release), one table after another, and prints a Markdown
table. Peak memory is the resident set of the whole process, program and map included. Standard library only.
"""
import argparse
import json
import math
import os
import shlex
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TOOL = os.path.join(ROOT, 'target', 'release', 'csbrdf')


def run(*args):
    """Runs the tool: its standard output, seconds and peak resident set in MB."""
    start = time.perf_counter()
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen([TOOL, *args], stdout=out, stderr=subprocess.PIPE)
        errors = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(errors.decode())
        out.seek(0)
        return out.read(), seconds, usage.ru_maxrss / 1024


def block_peak(path):
    """Peak resident set of the decode of a largest block in MB.

    What wait4 reports of a short process includes this one, of which it was forked. So the decode is read from while
    it waits on a full pipe, its work done.
    """
    blocks = json.loads(run('info', '--json', '--blocks', path)[0])['blocks']
    number = max(blocks, key=lambda block: math.prod(block['shape']))['number']
    process = subprocess.Popen([TOOL, 'decode', path, '--block', str(number), '--format', 'csv'], stdout=subprocess.PIPE)
    time.sleep(0.3)
    with open(f'/proc/{process.pid}/status') as status:
        peak = next((int(line.split()[1]) for line in status if line.startswith('VmHWM')), 0)
    process.stdout.read()
    if process.wait() or not peak:
        sys.exit(f'{path}: the block fits the pipe or did not decode')
    return peak / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('table', nargs='+')
    parser.add_argument('--out', help='folder for the files; a temporary one if not given')
    parser.add_argument('--encode', default='', help='options for `csbrdf encode`, quoted')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.out or temporary
        os.makedirs(folder, exist_ok=True)
        print('| table | bytes | ratio | log rms | R, G, B | max | render PSNR, dB | encode, s | encode peak, MB '
              '| decode --block peak, MB |')
        print('| --- ' * 10 + '|')
        for table in arguments.table:
            name = os.path.splitext(os.path.basename(table))[0]
            path = os.path.join(folder, name + '.csbrdf')
            _, seconds, peak = run('encode', '--force', '--quiet', *shlex.split(arguments.encode), table, '-o', path)
            comparison = json.loads(run('compare', '--json', table, path)[0])
            size, overall = os.path.getsize(path), comparison['overall']
            channels = ', '.join(f"{c['log_rms']:.5f}" for c in comparison['channels'])
            psnr = comparison['render_psnr_db']
            print(f"| {name} | {size:,} | {os.path.getsize(table) / size:.1f} | {overall['log_rms']:.5f} | {channels} "
                  f"| {overall['log_max']:.3f} | {'equal' if psnr is None else f'{psnr:.1f}'} | {seconds:.2f} "
                  f"| {peak:.0f} | {block_peak(path):.1f} |", flush=True)


if __name__ == '__main__':
    main()
