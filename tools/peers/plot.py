"""Rate-distortion curves, one small multiple a table, as SVG and PNG."""
import os

import numpy as np

from curves import LEVELS, is_peer

STYLE = {'SPERR': ('#0072b2', 'o'), 'SZ3': ('#e69f00', 's'), 'zfp': ('#009e73', '^'),
         'csbrdf': ('#b2182b', 'D'), 'csbrdf-fast': ('#ef8a62', 'v')}
SHOWN = (0.0046, 0.0545)


def draw(curves, tables, folder, name='rate-distortion'):
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter, NullLocator

    plt.rcParams.update({'svg.hashsalt': 'csbrdf', 'svg.fonttype': 'none', 'font.size': 9, 'font.family': 'sans-serif'})
    columns = min(4, len(tables))
    rows = -(-len(tables) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(3.1 * columns + 0.4, 2.7 * rows + 0.9), sharex=True, sharey=True,
                                squeeze=False, layout='constrained')
    # Further out the best ways of some codecs were not measured, and lesser ones would make a step.
    grid = np.geomspace(LEVELS[0], LEVELS[-1], 300)
    lowest, highest, handles = np.inf, 0, {}
    for axis, table in zip(axes.flat, tables):
        for codec, curve in curves[table.label].items():
            colour, marker = STYLE.get(codec, ('#666666', 'x'))
            bytes_ = np.array([curve(rms)[0] for rms in grid]) / 1000
            own = not is_peer(codec)
            handles[codec], = axis.plot(grid, bytes_, color=colour, lw=2 if own else 1.3, label=codec,
                                        zorder=4 if own else 3)
            # Of the measured points those that make the curve, not those of ways that lose.
            points = [p for way in curve.ways.values() for p in way
                      if grid[0] <= p['log_rms'] <= grid[-1] and p['bytes'] <= curve(p['log_rms'])[0] * 1.001]
            axis.plot([p['log_rms'] for p in points], [p['bytes'] / 1000 for p in points], marker, color=colour, ms=2.8,
                      zorder=4 if own else 3)
            lowest, highest = min(lowest, np.nanmin(bytes_)), max(highest, np.nanmax(bytes_))
        best = min((curve(0.01)[0] for codec, curve in curves[table.label].items() if is_peer(codec)), default=np.nan)
        own = curves[table.label].get('csbrdf')
        if own and best == best:
            axis.text(0.97, 0.95, f'at 0.01: {own(0.01)[0] / best:.2f} of best peer', transform=axis.transAxes, ha='right',
                      va='top', color=STYLE['csbrdf'][0], fontsize=8,
                      bbox={'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.8, 'pad': 1})
        if table.noisy:
            bound = np.array([table.bound_bytes(rms) for rms in grid]) / 1000
            handles['white-noise bound'], = axis.plot(grid, np.where(bound > 0, bound, np.nan), color='#333333', lw=1,
                                                      ls=(0, (3, 2)), label='white-noise bound')
            axis.fill_between(grid, np.maximum(bound, 1e-9), 1e-9, color='#333333', alpha=0.07, lw=0)
        axis.set_title(f'{table.label}' + (f'  (noise {table.sigma:.3f})' if table.noisy else ''), fontsize=9, pad=4,
                       loc='left', fontweight='bold')
    for axis in axes.flat[:len(tables)]:
        axis.set(xscale='log', yscale='log', xlim=SHOWN, ylim=(lowest * 0.8, highest * 1.15))
        axis.set_xticks(LEVELS, [f'{level:g}' for level in LEVELS])
        axis.xaxis.set_minor_locator(NullLocator())
        axis.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f'{v:,.0f}'))
        axis.grid(which='major', color='#dddddd', lw=0.7)
        axis.grid(which='minor', axis='y', color='#f2f2f2', lw=0.5)
        axis.set_axisbelow(True)
        axis.spines[['top', 'right']].set_visible(False)
    for axis in axes.flat[len(tables):]:
        axis.set_visible(False)
    for number in range(max(0, len(tables) - columns), len(tables)):
        axes.flat[number].xaxis.set_tick_params(labelbottom=True)
    figure.supxlabel('log rms error', fontsize=10)
    figure.supylabel('kB', fontsize=10)
    order = [c for c in STYLE if c in handles] + [c for c in handles if c not in STYLE]
    figure.legend([handles[c] for c in order], order, loc='outside upper center', ncols=len(order), frameon=False,
                  fontsize=10)
    for kind in ('svg', 'png'):
        figure.savefig(os.path.join(folder, f'{name}.{kind}'), dpi=110,
                       metadata={'Date': None} if kind == 'svg' else None)
    plt.close(figure)
