"""Points of codecs on tables, as CSV, as curves, as Markdown."""
import csv
import os

import numpy as np

COLUMNS = ('table', 'crc32', 'codec', 'variant', 'transform', 'setting', 'bytes', 'mask_bytes', 'log_rms', 'log_max',
           'encode_s', 'decode_s')
LEVELS = (0.005, 0.01, 0.02, 0.05)


def is_peer(codec):
    return not codec.startswith('csbrdf')


def write_csv(path, points):
    with open(path + '.part', 'w', newline='') as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator='\n')
        writer.writeheader()
        for point in points:
            writer.writerow({k: f'{v:.6g}' if isinstance(v, float) else v for k, v in point.items()})
    os.replace(path + '.part', path)


def read_csv(path):
    with open(path, newline='') as file:
        points = list(csv.DictReader(file))
    for point in points:
        for name in ('setting', 'log_rms', 'log_max', 'encode_s', 'decode_s'):
            point[name] = float(point[name])
        point['bytes'] = int(point['bytes'])
    return points


class Curve:
    """Bytes over log rms of one codec on one table: the least over its variants and transforms, each interpolated."""

    def __init__(self, points):
        self.ways = {}
        for point in points:
            self.ways.setdefault((point['variant'], point['transform']), []).append(point)
        for points in self.ways.values():
            points.sort(key=lambda p: (p['log_rms'], p['bytes']))

    def of_way(self, way, rms):
        """Bytes at log rms, interpolated in the logs; not a number outside of what was measured.

        A point that another one beats in both is raised to it first: nobody would use it.
        """
        points = self.ways[way]
        x = np.log([p['log_rms'] for p in points])
        y = np.minimum.accumulate(np.log([p['bytes'] for p in points]))
        return np.exp(np.interp(np.log(rms), x, y, left=np.nan, right=np.nan))

    def __call__(self, rms):
        """(bytes, way) at a log rms; (nan, None) where no way was measured on both sides."""
        found = [(float(self.of_way(way, rms)), way) for way in self.ways]
        found = [f for f in found if f[0] == f[0]]
        return min(found) if found else (float('nan'), None)

    def near(self, rms):
        """The point of the best way nearest to a log rms."""
        way = self(rms)[1] or next(iter(self.ways))
        return min(self.ways[way], key=lambda p: abs(np.log(p['log_rms'] / rms)))


def by_table(points, tables):
    """Label -> codec -> Curve, codecs in the order of their first point, peers first."""
    found = {table.label: {} for table in tables}
    labels = {table.crc32: table.label for table in tables}
    for point in sorted(points, key=lambda p: not is_peer(p['codec'])):
        if point['crc32'] in labels:
            found[labels[point['crc32']]].setdefault(point['codec'], []).append(point)
    return {label: {codec: Curve(p) for codec, p in codecs.items()} for label, codecs in found.items()}


def kb(value):
    return '-' if value != value else f'{value / 1000:,.1f}'


def ratio(value):
    return '-' if value != value else f'{value:.2f}'


def row(*cells):
    return '| ' + ' | '.join(map(str, cells)) + ' |'


def head(*cells):
    return row(*cells) + '\n' + row(*['---'] * len(cells))


def median(values):
    values = [v for v in values if v == v]
    return float(np.median(values)) if values else float('nan')


def markdown(curves, tables):
    """The tables that the README quotes."""
    lines = []
    codecs = list(dict.fromkeys(codec for label in curves for codec in curves[label]))
    peers, ours = [c for c in codecs if is_peer(c)], [c for c in codecs if not is_peer(c)]
    groups = (('clean and real', [t for t in tables if not t.noisy]), ('noisy', [t for t in tables if t.noisy]))
    get = lambda table, codec, rms: curves[table.label][codec](rms)[0] if codec in curves[table.label] else float('nan')

    summary = [head('log rms', 'tables', *(f'{c} / best peer' for c in ours), *(f'of them smaller: {c}' for c in ours))]
    for rms in LEVELS:
        lines += [f'kB at log rms {rms:g}:', '',
                  head('table', 'noise', *peers, *ours, *(f'{c} / best peer' for c in ours))]
        for name, members in groups:
            ratios, columns = {c: [] for c in ours}, {c: [] for c in codecs}
            for table in members:
                best = min([get(table, c, rms) for c in peers], key=lambda b: (b != b, b), default=float('nan'))
                for codec in codecs:
                    columns[codec].append(get(table, codec, rms))
                for codec in ours:
                    ratios[codec].append(get(table, codec, rms) / best)
                lines.append(row(table.label, f'{table.sigma:.4f}', *(kb(columns[c][-1]) for c in codecs),
                                 *(ratio(ratios[c][-1]) for c in ours)))
            if members:
                lines.append(row(f'**median, {name} ({len(members)})**', '', *(kb(median(columns[c])) for c in codecs),
                                 *(f'**{ratio(median(ratios[c]))}**' for c in ours)))
                counted = {c: [v for v in ratios[c] if v == v] for c in ours}
                summary.append(row(f'{rms:g}', f'{name} ({len(members)})', *(ratio(median(ratios[c])) for c in ours),
                                   *(f'{sum(v < 1 for v in counted[c])} of {len(counted[c])}' for c in ours)))
        lines.append('')
    lines = ['Medians of bytes / bytes of the best peer at equal log rms:', '', *summary, ''] + lines

    noisy = groups[1][1]
    if noisy:
        lines += ['Noisy tables, least kB that the white noise alone costs (bound), and kB above it (bytes / bound):', '',
                  head('table', 'noise', 'log rms', 'bound', *(f'{c} above' for c in codecs))]
        for table in noisy:
            for rms in LEVELS:
                bound = table.bound_bytes(rms)
                if not bound:
                    continue
                above = [get(table, c, rms) for c in codecs]
                lines.append(row(table.label, f'{table.sigma:.4f}', f'{rms:g}', kb(bound),
                                 *(f'{kb(b - bound)} ({ratio(b / bound)})' for b in above)))
        lines.append('')

    lines += ['At the measured points nearest to log rms 0.01, medians over all tables:', '',
              head('codec', 'log rms', 'largest log error', 'encode, s', 'decode, s')]
    for codec in codecs:
        near = [curves[t.label][codec].near(0.01) for t in tables if codec in curves[t.label]]
        lines.append(row(codec, *(f'{median([p[k] for p in near]):.{n}f}' for k, n in
                                  (('log_rms', 4), ('log_max', 3), ('encode_s', 2), ('decode_s', 2)))))
    lines += ['', 'What served the peers best at log rms 0.01 (variant, colours):', '', head('table', *peers)]
    for table in tables:
        ways = [curves[table.label][c](0.01)[1] if c in curves[table.label] else None for c in peers]
        lines.append(row(table.label, *(', '.join(w) if w else '-' for w in ways)))
    return '\n'.join(lines) + '\n'
