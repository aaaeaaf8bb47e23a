#!/usr/bin/env python3
"""Sum the tables that `cargo run --release --example damage` prints: over files and places, by kind of damage.

usage: tools/damage_table.py OUTPUT.txt...

Prints the Markdown table of docs/results.md, section Damage, after a line a run with its files. Standard library only.
"""
import re
import sys

COLUMNS = ['tried', 'restored', 'lost and said', 'refused', 'wrong']


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__.split('\n\n')[1])
    kinds = {}
    for path in sys.argv[1:]:
        files, stated, found = [], [0] * len(COLUMNS), [0] * len(COLUMNS)
        for line in open(path, encoding='utf-8'):
            if head := re.match(r'(\S+): ([\d,]+) bytes, (\d+) blocks, (\d+) cases', line):
                files.append(head[1])
            cells = [cell.strip() for cell in line.strip().strip('|').split('|')]
            if not line.startswith('|') or len(cells) < 7 or not cells[2].isdigit():
                continue
            counts = [int(cell) for cell in cells[2:7]]
            sums = stated if cells[0] == 'all' else kinds.setdefault(cells[0], [0] * len(COLUMNS))
            for total in [sums] if sums is stated else [sums, found]:
                total[:] = [a + b for a, b in zip(total, counts)]
        if stated != found:
            sys.exit(f'{path}: the rows sum to {found}, its lines "all" to {stated}')
        print(f'{path}: {len(files)} files, {found[0]:,} cases: {", ".join(files)}')
    print()
    rows = [*kinds.items(), ('**all**', [sum(column) for column in zip(*kinds.values())])]
    print('| damage | ' + ' | '.join(COLUMNS) + ' |')
    print('| --- |' + ' --- |' * len(COLUMNS))
    for kind, counts in rows:
        print(f'| {kind} | ' + ' | '.join(f'{count:,}' for count in counts) + ' |')


if __name__ == '__main__':
    main()
