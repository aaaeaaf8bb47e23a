"""MERL tables as the codecs get them: log domain, holes filled, mask priced, noise estimated."""
import lzma
import zlib

import numpy as np

EPS = 1e-3  # 1/sr, of the tone map ln(f + EPS)
SCALE = np.array([1, 1.15, 1.66]) / 1500  # MERL's units to 1/sr: R, G, B
PHI_WEIGHT = 10  # of neighbours along phi_d in the harmonic fill, against 1 along theta_h and theta_d
NOISY = 0.01  # a table of more white noise than this, in the log, counts as noisy
RAW_LZMA = [{'id': lzma.FILTER_LZMA1, 'preset': 9 | lzma.PRESET_EXTREME}]


def read(path):
    """Values in 1/sr [3, theta_h, theta_d, phi_d] and their validity [theta_h, theta_d, phi_d]."""
    with open(path, 'rb') as file:
        shape = np.fromfile(file, '<i4', 3)
        values = np.fromfile(file, '<f8')
    values = values.reshape(3, *shape) * SCALE[:, None, None, None]
    with np.errstate(invalid='ignore'):
        valid = (values >= 0) & np.isfinite(values)
    if (valid != valid[0]).any():
        raise SystemExit(f'{path}: channels differ in validity, which this tool gives the peers no mask for')
    return np.where(valid, values, 0), valid[0]


def log_error(log, decoded, valid):
    """Rms and largest difference of two tables of ln(f + EPS) over the valid entries of all channels.

    Values that decode below f = 0 count as 0: any decoder would clamp them.
    """
    difference = np.maximum(decoded[:, valid], np.log(EPS)) - log[:, valid]
    return float(np.sqrt(np.mean(difference**2))), float(np.abs(difference).max())


def squeeze(data):
    """LZMA over a stream, without a container, or the stream itself where that is shorter; a byte says which."""
    packed = lzma.compress(data, lzma.FORMAT_RAW, filters=RAW_LZMA)
    return b'\1' + packed if len(packed) < len(data) else b'\0' + data


def unsqueeze(data):
    return lzma.decompress(data[1:], lzma.FORMAT_RAW, filters=RAW_LZMA) if data[0] else data[1:]


def lowest_elevation(shape):
    """Cosine of the lower of the two directions at the bin centres."""
    halves = [(np.arange(n) + 0.5) / n for n in shape]
    theta_h, theta_d, phi_d = np.meshgrid(
        halves[0] ** 2 * np.pi / 2, halves[1] * np.pi / 2, halves[2] * np.pi, indexing='ij')
    across = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
    return np.cos(theta_h) * np.cos(theta_d) - np.abs(across)


def mask_bytes(valid):
    """What the validity costs a peer: the cheapest of simple means.

    LZMA over packed bits, in three orders of the axes; the bits as they are, or as exceptions from the rule "the lower
    direction's cosine is at least t", with 4 bytes for the t that leaves fewest exceptions.
    """
    elevation = lowest_elevation(valid.shape).ravel()
    order = np.argsort(elevation)
    below = valid.ravel()[order]
    # Exceptions with the threshold before entry n: valid ones below it, invalid ones from it on.
    wrong = np.concatenate([[0], np.cumsum(below)]) + np.concatenate([np.cumsum(~below[::-1])[::-1], [0]])
    rule = np.empty(valid.size, bool)
    rule[order] = np.arange(valid.size) >= wrong.argmin()
    exceptions = valid ^ rule.reshape(valid.shape)
    orders = ((0, 1, 2), (0, 2, 1), (2, 0, 1))
    size = lambda bits: min(len(squeeze(np.packbits(bits.transpose(axes)).tobytes())) for axes in orders)
    return min(size(valid), size(exceptions) + 4)


def fill(log, valid):
    """The holes of every channel as the solution of Laplace's equation, periodic in phi_d (MERL's is half a turn)."""
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import cg

    holes = ~valid
    count = int(holes.sum())
    if not count:
        return log
    number = np.full(valid.shape, -1)
    number[holes] = np.arange(count)
    own = number[holes]
    diagonal, sums = np.zeros(count), np.zeros((len(log), count))
    rows, columns, weights = [], [], []
    for axis, weight in ((0, 1.0), (1, 1.0), (2, PHI_WEIGHT)):
        for step in (1, -1):
            exists = np.ones(valid.shape, bool)
            if axis < 2:
                exists[(slice(None),) * axis + (-1 if step == 1 else 0,)] = False
            exists = exists[holes]
            neighbour = np.roll(number, -step, axis)[holes]
            diagonal += weight * exists
            inner = exists & (neighbour >= 0)
            rows.append(own[inner])
            columns.append(neighbour[inner])
            weights.append(np.full(inner.sum(), -weight))
            border = exists & (neighbour < 0)
            for channel in range(len(log)):
                sums[channel, border] += weight * np.roll(log[channel], -step, axis)[holes][border]
    join = np.concatenate
    matrix = csr_array((join(weights), (join(rows), join(columns))), (count, count)) + diags_array(diagonal)
    filled = log.copy()
    for channel in range(len(log)):
        start = np.full(count, log[channel][valid].mean())
        solution, state = cg(matrix, sums[channel], start, rtol=1e-5, maxiter=5000, M=diags_array(1 / diagonal))
        if state:
            raise SystemExit(f'the fill of holes did not converge ({state})')
        filled[channel][holes] = solution
    return filled


def noise_sigma(values, valid):
    """White multiplicative noise: sigma of ln f.

    Fourth differences of ln(f + EPS) along phi_d, where tables are smoothest, over the valid entries of f > EPS with both
    directions well above the horizon (cosine > 0.3), where nothing else is left of them; each divided by f / (f + EPS),
    the slope of the tone map, and by sqrt(70), what they make of white noise; the median of their sizes over that of a
    normal distribution. Right to 1 % on tables of known noise.
    """
    weights = (1, -4, 6, -4, 1)
    window = lambda array, n: array[..., n:array.shape[-1] - 4 + n]
    differences = sum(w * window(np.log(values + EPS), n) for n, w in enumerate(weights))
    centre = window(values, 2)
    usable = np.logical_and.reduce([window(valid, n) for n in range(5)])
    usable = usable & (window(lowest_elevation(valid.shape), 2) > 0.3) & (centre > EPS)
    sizes = np.abs(differences * (centre + EPS))[usable] / centre[usable]
    return float(np.median(sizes) / 0.67449 / np.sqrt(70))


class Table:
    """A table, its label, and what was worked out once for all codecs."""

    def __init__(self, path, label):
        self.path, self.label = path, label
        with open(path, 'rb') as file:
            self.crc32 = f'{zlib.crc32(file.read()):08x}'
        values, self.valid = read(path)
        self.log = np.log(values + EPS)
        self.sigma = noise_sigma(values, self.valid)
        valid_values = values[:, self.valid].ravel()
        self.sigmas = np.sort(self.sigma * valid_values / (valid_values + EPS))
        # Sums over the entries of less noise: of s_i^2, and of log2 s_i where s_i is not 0.
        self.squares = np.concatenate([[0], np.cumsum(self.sigmas**2)])
        self.logs = np.concatenate([[0], np.cumsum(np.log2(np.maximum(self.sigmas, 1e-30)))])

    @property
    def noisy(self):
        return self.sigma > NOISY

    def bound_bytes(self, rms):
        """Least bytes for the noise alone at a log rms: sum of max(0, log2(s_i / d)) bits over the entries.

        s_i is the noise of an entry of ln(f + EPS), d the level of error (reverse water-filling: entries of less noise
        cost nothing and err by their noise) at which the rms of min(s_i, d) is the one asked for.
        """
        count, budget = len(self.sigmas), rms**2 * len(self.sigmas)
        if budget >= self.squares[-1]:
            return 0.0
        # Entries below `first` err by their noise, the others by the level.
        low, first = 0, count
        while low < first:
            middle = (low + first) // 2
            if self.squares[middle] + self.sigmas[middle] ** 2 * (count - middle) < budget:
                low = middle + 1
            else:
                first = middle
        level = np.sqrt((budget - self.squares[first]) / (count - first))
        return float((self.logs[-1] - self.logs[first] - (count - first) * np.log2(level)) / 8)

    def release(self):
        """Forgets the table itself."""
        self.log = self.valid = None
