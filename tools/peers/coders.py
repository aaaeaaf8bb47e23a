"""The codecs that are compared. A peer is encode(planes, setting, variant) -> streams and
decode(streams, shape, variant) -> planes; float32, one thread."""
import os
import resource
import shlex
import subprocess
import time

import numpy as np

import tables
from curves import Curve

# Colours: rows make components of R, G, B; all orthonormal, so that equal errors of components are equal errors of RGB.
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3], [2], [6]])


def colour_transforms(table):
    """Name -> matrix and its bytes. `pca` is the best orthonormal one for the table, sent as float32."""
    values = table.log[:, table.valid]
    _, axes = np.linalg.eigh(np.cov(values))
    return {'none': (np.eye(3), 0), 'opponent': (OPPONENT, 0), 'pca': (axes.T[::-1].astype('f4').astype('f8'), 36)}


class Sperr:
    """SPERR 0.8 in its PSNR mode, the whole table one chunk, and LZMA over its stream where that saves bytes.

    The order of the axes decides which transform it takes: with phi_d the slowest a wavelet packet (more decompositions
    along it), else a dyadic one.
    """
    name, start, finest = 'SPERR', 0.03, 1.05
    variants = ('phi slowest', 'phi fastest')

    def encode(self, planes, rms, variant):
        import imagecodecs
        streams = []
        for plane in planes:
            if variant == 'phi slowest':
                plane = np.ascontiguousarray(plane.transpose(2, 0, 1))
            # The PSNR is to the plane's own range. One rms for all components comes to one quantiser step for all.
            psnr = 20 * np.log10(max(float(np.ptp(plane)), 1e-6) / rms)
            streams.append(tables.squeeze(bytes(imagecodecs.sperr_encode(plane, max(psnr, 1.0), 'psnr', numthreads=1))))
        return streams

    def decode(self, streams, shape, variant):
        import imagecodecs
        planes = [imagecodecs.sperr_decode(tables.unsqueeze(stream), numthreads=1) for stream in streams]
        if variant == 'phi slowest':
            return [plane.reshape(shape[2], *shape[:2]).transpose(1, 2, 0) for plane in planes]
        return [plane.reshape(shape) for plane in planes]


class Sz3:
    """SZ3 with an absolute bound and each of its predictors."""
    name, start, finest = 'SZ3', 0.04, 1.05
    variants = ('interp-lorenzo', 'interp', 'lorenzo-reg')

    def encode(self, planes, bound, variant):
        from pysz import sz, szAlgorithm, szConfig, szErrorBoundMode
        streams = []
        for plane in planes:
            config = szConfig(plane.shape)
            config.errorBoundMode = szErrorBoundMode.ABS
            config.absErrorBound = bound
            config.openmp = False
            config.cmprAlgo = {'interp-lorenzo': szAlgorithm.INTERP_LORENZO, 'interp': szAlgorithm.INTERP,
                               'lorenzo-reg': szAlgorithm.LORENZO_REG}[variant]
            streams.append(sz.compress(plane, config)[0].tobytes())
        return streams

    def decode(self, streams, shape, _):
        from pysz import sz
        return [sz.decompress(np.frombuffer(stream, 'u1'), np.float32, shape)[0] for stream in streams]


class Zfp:
    """zfp, fixed accuracy; its tolerance acts in powers of two. LZMA over its stream where that saves bytes."""
    name, variants, start, finest = 'zfp', ('accuracy',), 0.5, 2

    def encode(self, planes, tolerance, _):
        import zfpy
        return [tables.squeeze(zfpy.compress_numpy(plane, tolerance=tolerance)) for plane in planes]

    def decode(self, streams, shape, _):
        import zfpy
        return [zfpy.decompress_numpy(tables.unsqueeze(stream)) for stream in streams]


PEERS = (Sperr, Sz3, Zfp)


def ladder(measure, start, levels):
    """Points measure(setting) at start and by octaves down and up, until they enclose the levels of log rms."""
    points = [measure(start)]
    for factor, enclosed in ((0.5, lambda rms: rms < levels[0]), (2, lambda rms: rms > levels[-1])):
        last = points[0]
        for _ in range(12):
            if enclosed(last['log_rms']):
                break
            last = measure(last['setting'] * factor)
            points.append(last)
    return points


def refine(measure, points, level, finest):
    """More points until those next to a level differ by less than a quarter in bytes, or by `finest` in the setting."""
    for _ in range(4):
        below = max((p for p in points if p['log_rms'] <= level), key=lambda p: p['log_rms'], default=None)
        above = min((p for p in points if p['log_rms'] > level), key=lambda p: p['log_rms'], default=None)
        if not below or not above or below['bytes'] < 1.25 * above['bytes']:
            break
        low, high = sorted((below['setting'], above['setting']))
        if high < 1.01 * finest * low:
            break
        points.append(measure((low * high) ** 0.5))


def measure_peer(codec, table, filled, mask, levels):
    """Points of one peer on one table: all its variants and colours in octaves, the best ones closely.

    Seconds are of the processor.
    """
    points = []
    shape = table.valid.shape
    transforms = colour_transforms(table)

    def measure(setting, variant, transform):
        matrix, matrix_bytes = transforms[transform]
        begin = time.process_time()
        planes = np.ascontiguousarray(np.tensordot(matrix, filled, 1), dtype=np.float32)
        streams = codec.encode(planes, setting, variant)
        encoded = time.process_time()
        planes = np.stack(codec.decode(streams, shape, variant))
        decoded = np.tensordot(matrix.T.astype('f4'), planes, 1)
        end = time.process_time()
        rms, largest = tables.log_error(table.log, decoded.astype('f8'), table.valid)
        points.append({
            'table': table.label, 'crc32': table.crc32, 'codec': codec.name, 'variant': variant,
            'transform': transform, 'setting': setting, 'bytes': sum(map(len, streams)) + mask + matrix_bytes,
            'mask_bytes': mask, 'log_rms': rms, 'log_max': largest, 'encode_s': encoded - begin,
            'decode_s': end - encoded})
        return points[-1]

    for transform in transforms:
        for variant in codec.variants:
            ladder(lambda setting: measure(setting, variant, transform), codec.start, levels)
    for level in levels:
        way = Curve(points)(level)[1]
        if way:
            refine(lambda setting: measure(setting, *way), Curve(points).ways[way], level, codec.finest)
    return points


def run(command):
    """Runs a program; its processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.run(command, capture_output=True, text=True)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}\n{process.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure_csbrdf(name, tool, options, table, folder, levels):
    """Points of csbrdf: whole processes, one thread, file to file; the error is of the .binary that it decodes to."""
    points = []
    coded, back = os.path.join(folder, 'table.csbrdf'), os.path.join(folder, 'table.binary')

    def measure(step):
        encode_s = run([tool, 'encode', '--force', '--quiet', '--threads', '1', '--quality', f'{step:.6g}',
                        *shlex.split(options), table.path, '-o', coded])
        decode_s = run([tool, 'decode', '--force', '--quiet', '--threads', '1', coded, '-o', back])
        values, valid = tables.read(back)
        if (valid != table.valid).any():
            raise SystemExit(f'{table.label}: csbrdf gave back another validity')
        rms, largest = tables.log_error(table.log, np.log(values + tables.EPS), valid)
        points.append({
            'table': table.label, 'crc32': table.crc32, 'codec': name, 'variant': options, 'transform': '',
            'setting': step, 'bytes': os.path.getsize(coded), 'mask_bytes': '', 'log_rms': rms, 'log_max': largest,
            'encode_s': encode_s, 'decode_s': decode_s})
        return points[-1]

    ladder(measure, 0.1, levels)
    for level in levels:
        refine(measure, list(points), level, 1.05)
    return points
