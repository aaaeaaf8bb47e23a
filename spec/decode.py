#!/usr/bin/env python3
"""A plain decoder of .csbrdf files (format 1.0 and its drafts 1 to 5), written from csbrdf.md alone.

    decode.py FILE...                   name and CRC-32 of the values, the binary64 values / scale, the validity
    decode.py --check HASHES [FILE...]  compare these with a list; exit 1 on a difference
    decode.py -o OUT.npy FILE           write the binary32 values [channel][axes...]
    decode.py --block N FILE            decode one block and print its values
    decode.py --samples FILE...         print how many entries of each block are samples, by channel
    decode.py --exact [...] FILE        the values of a lossless file's source, bit for bit, those that are not valid
                                        included: with -o OUT.npy or OUT.binary (MERL's form) or --block N these
                                        instead of the decoded ones, else their CRC-32 as well
    decode.py --allow-pruned [...] FILE decode pruned blocks too, as blocks without valid entries; without this they
                                        are an error. --check always allows them

Needs NumPy. Every operation on arrays is elementwise, in the precision of the array, so the order and the roundings are
those of the specification. Numbers in docstrings and comments, like 3.5 or A.4, are its sections. META (3.7) is not
decoded, only its CRC is checked.
"""
import argparse
import bisect
import itertools
import math
import os
import struct
import sys
import zlib
from collections import Counter

import numpy as np

F32, F64 = np.float32, np.float64
AXES = ["other", "theta_h", "phi_h", "theta_d", "phi_d", "theta_i", "phi_i", "theta_o", "phi_o"]
ALL, NONE, HORIZON, MASK, MASK_PER_CHANNEL, PRUNED = range(6)  # classes of validity, 3.8
ANY, EXTENT, ROW, SIGNIFICANT, EXPONENT, MANTISSA, MASKS, ZEROS = 0, 3, 195, 276, 708, 1308, 1333, 1397  # 4.6
C_ANY, C_ROW, C_PRESENT, C_EXPONENT, C_MANTISSA, C_SIGN, CONTEXTS = 1437, 1440, 1449, 1549, 1599, 1624, 1633  # 4.11
D_SIGNIFICANT, D_CONTEXTS = 1633, 2065  # 4.6, of dependent quantisation
P_STORED, P_EXPONENT, P_MANTISSA, P_CONTEXTS = 0, 4, 29, 54  # 3.5
X_MISSING, X_SIGN, X_TOP, X_LENGTH, X_MISSING_LENGTH, X_CONTEXTS = 0, 3, 9, 521, 4617, 4745  # 4.12
LEVEL = [0, 1, 2, 3, 4, 5, 6, 7, 7] + [8] * 3 + [9] * 5 + [10] * 12  # 4.6, above: 11
NEXT_STATE = [(0, 2), (2, 0), (1, 3), (3, 1)]  # 4.5: after an even quantiser index, an odd one


class Refused(Exception):
    """5: what is reserved, out of range, contradictory or damaged; 3.8: what was pruned."""


class Cursor:
    """Reads a section field by field and names section and offset when a field is refused."""

    def __init__(self, name, data):
        self.name, self.data, self.pos, self.at = name, data, 0, 0

    def check(self, ok, what):
        if not ok:
            raise Refused(f"{self.name}, offset {self.at}: {what}")

    def bytes(self, count):
        self.at = self.pos
        self.check(count <= len(self.data) - self.pos, "the section ends too early")
        self.pos += count
        return self.data[self.at:self.pos]

    def get(self, kind, what, low=None, high=None):
        """One little-endian number (a letter of struct), refused outside [low, high]; NaN is outside of everything."""
        value, = struct.unpack("<" + kind, self.bytes(struct.calcsize("<" + kind)))
        self.check(low is None or value >= low, f"{what} is {value}")
        self.check(high is None or value <= high, f"{what} is {value}")
        return value

    def end(self):
        self.at = self.pos
        self.check(self.pos == len(self.data), "bytes after the last field")


# ---------------------------------------------------------------------------------------------------- 2. Arithmetic

def horner(coefficients, x):
    """2: ((c_m x + c_(m-1)) x + ...) x + c_0 in the precision of x."""
    result = x.dtype.type(0) * x
    for i, c in enumerate(coefficients):
        result = (result if i == 0 else result * x) + x.dtype.type(c)
    return result


def C(x):
    """2: cosine near 0."""
    z = x * x
    return horner([(-1) ** (m // 2) / math.factorial(m) for m in range(18, 0, -2)], z) * z + 1.0


def S(x):
    """2: sine near 0."""
    z = x * x
    return (horner([(-1) ** (m // 2) / math.factorial(m) for m in range(19, 1, -2)], z) * z) * x + x


def cos_turn(p, q):
    """2: cosine of 2 pi p / q; p an array of integers, q an integer."""
    e = (8 * p) % (8 * q)
    e = np.minimum(e, 8 * q - e)
    sign = np.where(e > 2 * q, -1.0, 1.0)
    e = np.where(e > 2 * q, 4 * q - e, e)
    near = C(e.astype(F64) / F64(q) * F64(math.pi / 4))
    far = S((2 * q - e).astype(F64) / F64(q) * F64(math.pi / 4))
    return sign * np.where(e <= q, near, far)


def sin_cos(a):
    """2: (sin, cos) of an array of f64 angles."""
    t = a * F64(2 / math.pi) + F64(6755399441055744)
    k = t.view(np.int64) & 3
    r = a - (t - F64(6755399441055744)) * F64(math.pi / 2)
    s, c = S(r), C(r)
    return np.choose(k, [s, c, -s, -c]), np.choose(k, [c, -s, -c, s])


def exp(x, kind, lowest, highest, magic, high_bits, low_bits, degree):
    """2: what exp32 and exp64 share; kind is the precision."""
    y = np.maximum(np.minimum(x, kind(highest)), kind(lowest))
    s = y * kind(1.4426950408889634) + kind(magic)
    n = s - kind(magic)
    r = (y - n * high_bits) - n * low_bits
    p = horner([1 / math.factorial(m) for m in range(degree, -1, -1)], r)
    with np.errstate(over="ignore"):
        result = (p * np.ldexp(kind(1), n.astype(np.int32) - 1)) * kind(2)
    return np.where(x < kind(lowest), kind(0), np.minimum(result, np.finfo(kind).max))


def exp32(x):
    """2: exp in binary32."""
    h, l = np.array([0x3F317200, 0x35BFBE8E], np.uint32).view(F32)
    return exp(x, F32, -86, 89, 12582912, h, l, 7)


def exp64(x):
    """2: exp in binary64."""
    h, l = np.array([0x3FE62E42FEE00000, 0x3DEA39EF35793C76], np.uint64).view(F64)
    return exp(x, F64, -708, 710, 6755399441055744, h, l, 13)


# ------------------------------------------------------------------------------------------------- 3. The container

class File:
    """3: a file whose header sections have been checked. Pruned blocks (3.8) are refused unless they are allowed."""

    def __init__(self, data, allow_pruned=False):
        self.data, self.allow_pruned = data, allow_pruned
        self.container()
        self.doublings, self.pruned = {}, set()  # of the blocks decoded so far
        self.tables = self.parts = None
        for read in (self.grid, self.code, self.part, self.prob, self.graz, self.indx):
            name = read.__name__.upper()
            if name != "GRAZ" or b"GRAZ" in self.sections:
                cursor = Cursor(name, self.section(name))
                read(cursor)
                cursor.end()

    def container(self):
        """3.1: preamble, section table, end marker."""
        c = Cursor("preamble", self.data)
        c.check(c.bytes(8) == b"\x8bCSB\r\n\x1a\n", "not a csbrdf file")
        major = c.get("H", "major version")
        c.check(major == 1, f"major version {major} is not known")
        minor = c.get("H", "minor version")
        draft = c.get("H", "draft")
        c.check(draft == 0 or minor == 0 and draft <= 5, f"draft {draft} of version {major}.{minor} is not known")
        # Appendix A: a final version has all that the drafts brought.
        self.draft = draft = draft or 6
        self.before_3, self.before_4 = draft < 3, draft < 4
        count = c.get("H", "number of sections", 1, 64)
        c.check(c.get("Q", "length of the file") == len(self.data), f"the file has {len(self.data)} bytes")
        c.get("I", "reserved field", 0, 0)
        crc = c.get("I", "CRC")
        table = c.bytes(20 * count)
        c.check(zlib.crc32(self.data[:28] + table) == crc, "CRC of preamble and section table is wrong")
        self.sections, begin = {}, 32 + 20 * count
        t = Cursor("section table", table)
        for _ in range(count):
            name = t.bytes(4)
            t.check(name.isascii() and name not in self.sections, f"identifier {name} twice or not ASCII")
            flags = t.get("I", "flags", 0, 1)
            t.check(name != b"GRAZ" or not self.before_3, f"section GRAZ in draft {self.draft}")
            known = name in (b"GRID", b"CODE", b"PART", b"PROB", b"GRAZ", b"INDX", b"META", b"RECS")
            known |= name == b"SPAR" or name == b"EXCT" and not self.before_3  # A.2; SPAR is for repairs (3.11)
            t.check(known or flags & 1, f"unknown section {name} is not skippable")
            length = t.get("Q", "length of a section", 0, len(self.data) - begin)
            self.sections[name] = (begin, length, t.get("I", "CRC"))
            begin += length
        t.check(begin == len(self.data) - 8, "the sections do not end 8 bytes before the end of the file")
        t.check(self.data[begin:] == b"CSBRDF.\n", "no end marker")
        t.check(b"RECS" in self.sections, "there is no section RECS")

    def section(self, name):
        """3.1: the bytes of a section, its CRC checked."""
        if name.encode() not in self.sections:
            raise Refused(f"section table: there is no section {name}")
        begin, length, crc = self.sections[name.encode()]
        data = self.data[begin:begin + length]
        if zlib.crc32(data) != crc:
            raise Refused(f"{name}, offset 0: CRC of the section is wrong")
        return data

    def grid(self, c):
        """3.2 GRID."""
        self.naxes = c.get("B", "number of axes", 1, 4)
        self.axes = []  # (name, square mapping, bins, start, end)
        for _ in range(self.naxes):
            name, square = AXES[c.get("B", "name of an axis", 0, 8)], c.get("B", "mapping", 0, 1)
            c.get("H", "reserved field", 0, 0)
            bins = c.get("I", "number of bins", 1, 65536)
            start = c.get("d", "start", -1e6, 1e6)
            end = c.get("d", "end", math.nextafter(start, math.inf), 1e6)
            self.axes.append((name, square, bins, start, end))
        self.axes = [("other", 0, 1, 0.0, 1.0)] * (4 - self.naxes) + self.axes
        self.shape = tuple(axis[2] for axis in self.axes)
        c.check(math.prod(self.shape) <= 1 << 34, "more than 2^34 positions")
        self.channels = c.get("H", "number of channels", 1, 4096)
        self.scale = []
        for _ in range(self.channels):
            self.scale.append(c.get("d", "scale", math.ulp(0.0), sys.float_info.max))
            wavelength = c.get("d", "wavelength", 0.0, sys.float_info.max)
            c.check(math.copysign(1.0, wavelength) > 0, "wavelength is -0")
            name = c.bytes(c.get("B", "length of the name"))
            try:
                name.decode("utf-8")
            except UnicodeDecodeError:
                c.check(False, "the name of a channel is not UTF-8")

    def code(self, c):
        """3.3 CODE."""
        self.dft = c.get("B", "basis", 0, 1)
        c.get("B", "tone map", 1, 1)
        self.dependent = c.get("B", "entropy coder", 1, 1 if self.before_4 else 2) == 2
        matrix = c.get("B", "channel transform", 0, 1)
        c.check(not matrix or self.channels <= 16, "a matrix of more than 16 channels")
        self.shrink = [c.get("b", "shrink of magnitude 1"), c.get("b", "shrink of magnitudes 2 and above")]
        horizon = c.get("B", "horizon", 0, 1)
        self.has_zeros = c.get("B", "exact zeros", 0, 0 if self.before_3 else 1)  # A.3
        self.eps = c.get("d", "eps", 1e-300, 1e30)
        threshold = c.get("d", "elevation of the horizon", -1.0, 1.0)
        c.check(horizon or struct.pack("<d", threshold) == bytes(8), "an elevation, but no horizon")
        named = {"theta_h", "theta_d", "phi_d"} <= {axis[0] for axis in self.axes}
        self.threshold = threshold if horizon and named else None
        self.seed = c.get("Q", "seed")
        self.ratio = c.get("I", "sampling ratio")
        self.step = [F32(c.get("f", "step", F32(1e-12), F32(1e6))) for _ in range(self.channels)]
        self.matrix = None
        if matrix:
            self.matrix = [[F32(c.get("f", "entry of the matrix", -F32(1.001), F32(1.001))) for _ in self.step]
                           for _ in self.step]
        self.correction = F32(0)
        if not self.before_3:  # A.3
            raw = c.get("f", "correction step", F32(0), F32(1e6))
            c.check(struct.pack("<f", raw) == bytes(4) or raw >= F32(1e-12), f"correction step is {raw}")
            self.correction = F32(raw)

    def part(self, c):
        """3.4 PART. Only the axes that GRID lists are stored; the ones in front have length 1."""
        def shape(name, limits):
            stored = [c.get("I", f"length of {name}", 1, limit) for limit in limits[4 - self.naxes:]]
            return (1,) * (4 - self.naxes) + tuple(stored)

        self.tile = shape("a tile", self.shape)
        self.block_shapes = []
        for _ in range(c.get("B", "number of block shapes less 1") + 1):
            self.block_shapes.append(shape("a block", [min(n, 1024) for n in self.tile]))
            size = math.prod(self.block_shapes[-1])
            c.check(size <= 1 << 21 and size * self.channels <= 1 << 24, "a block is too large")
            work = size * self.channels * sum(n for n in self.block_shapes[-1] if n > 1)
            c.check(work <= 1 << 30, "a block takes too long")
        found = set()
        for axis, (n, tile) in enumerate(zip(self.shape, self.tile)):
            for t, s in itertools.product((tile, n % tile), (shape[axis] for shape in self.block_shapes)):
                found |= {min(s, t), t % s}
        c.check(sum(n * n for n in found) <= 1 << 22, "too many different lengths of blocks")
        tiles = math.prod(-(-n // t) for n, t in zip(self.shape, self.tile))
        self.tile_shape_numbers = c.bytes(tiles)
        c.check(max(self.tile_shape_numbers) < len(self.block_shapes), "a tile's shape number is too large")

    def prob(self, c):
        """3.5 PROB."""
        contexts = ZEROS if self.before_3 else D_CONTEXTS if self.dependent else CONTEXTS  # A.4
        c.get("H", "number of contexts", contexts, contexts)
        self.probabilities = self.plain_probabilities(c, contexts) if self.before_4 else \
            self.coded_probabilities(c, contexts)

    def plain_probabilities(self, c, contexts):
        """A.4: stored as codes in draft 3, as they are in drafts 1 and 2."""
        bits = int.from_bytes(c.bytes(-(-contexts // 8)), "little")
        c.check(bits >> contexts == 0, "padding is not 0")

        def stored():
            if self.before_3:
                return c.get("H", "probability", 1)
            code = c.get("B", "code of a probability")
            return probability(-code if code < 128 else code - 128)

        return [stored() if bits >> i & 1 else 32768 for i in range(contexts)]

    def coded_probabilities(self, c, contexts):
        """3.5: stored as changes of ranks, range coded."""
        coded = c.bytes(len(c.data) - c.pos)
        coder = RangeDecoder(coded, [32768] * P_CONTEXTS)
        probabilities, rank, before, second = [], 0, 0, 0  # before, second: whether the last two were stored
        for context in range(contexts):
            before, second = coder.bit(P_STORED + before + 2 * second), before  # 1
            if before:  # 2
                change = number(coder, P_EXPONENT, P_MANTISSA, c)
                rank += -change if change and coder.raw(1) else change
                c.check(-127 <= rank <= 127, f"context {context}: rank {rank}")
            probabilities.append(probability(rank) if before else 32768)
        c.check(coder.pos >= len(coded), "not all coded bytes are used")
        return probabilities

    def graz(self, c):
        """3.9 GRAZ: self.tables[even, odd over theta_h, even, odd over theta_d][component][bin][knot]."""
        names = [axis[0] for axis in self.axes[4 - self.naxes:]]
        c.check(names == ["theta_h", "theta_d", "phi_d"], f"a grazing profile over {', '.join(names)}")
        self.knots = c.get("B", "number of knots", 2, 64)
        c.check(c.bytes(3) == bytes(3), "reserved bytes are not 0")
        self.zone = F32(c.get("f", "zone", F32(1e-6), 1.0))
        step = F32(c.get("f", "step", F32(1e-12), F32(1e6)))
        bins = [self.shape[axis] for axis in (1, 1, 2, 2)]
        for n in bins:
            c.check(n <= 1024, f"a table of {n} bins")
            size = n * self.knots * self.channels
            c.check(size <= 1 << 24 and size * ((n if n > 1 else 0) + self.knots) <= 1 << 30, "a table is too large")
        first = [[c.get("i", "quantised coefficient", -1 << 24, 1 << 24) for _ in self.step] for _ in bins]
        coded = c.bytes(len(c.data) - c.pos)
        coder = RangeDecoder(coded, [32768] * CONTEXTS)
        self.tables = []
        for n, means in zip(bins, first):
            table, before = [], None
            for channel, mean in enumerate(means):
                q = np.zeros((1, 1, n, self.knots), np.int64)
                before = coefficients(coder, channel, q.shape, before, c)
                for place, value in before.values.items():
                    q[place] = value
                q[0, 0, 0, 0] = mean
                table.append(synthesize_dct(q.astype(F32) * step)[0, 0])
            self.tables.append(table)
        c.check(coder.pos >= len(coded), "not all coded bytes are used")

    def indx(self, c):
        """3.6 INDX. The blocks are listed here as well: their number must be that of the partition."""
        begin, length, _ = self.sections[b"RECS"]
        count = c.get("I", "number of blocks", 0, length)
        c.check(self.before_3 or count * self.channels <= 1 << 24, "too many means")  # A.5
        self.blocks = list(itertools.islice(self.block(), count + 1))
        c.check(len(self.blocks) == count, f"{count} blocks are not those of the partition")
        lengths, self.means = self.plain_entries(c) if self.before_3 else self.coded_entries(c)
        c.check(sum(lengths) == length, "the lengths of the records do not add up to that of RECS")
        self.records = list(zip(itertools.accumulate(lengths, initial=begin), lengths))
        c.check(all(abs(q) <= 1 << 24 for means in self.means for q in means), "a mean of more than 2^24")

    def exct(self):
        """3.10 EXCT: self.usual, bits by channel, and self.parts, (begin, length) by block. Only when asked for."""
        if b"EXCT" not in self.sections or self.before_3:
            raise Refused("section table: there is no section EXCT, the file is not lossless")
        begin, length, _ = self.sections[b"EXCT"]
        c = Cursor("EXCT", self.data[begin:begin + length])
        c.get("I", "number of blocks", len(self.blocks), len(self.blocks))
        self.usual = [c.get("Q", "usual bits") for _ in self.step]
        lengths = [c.get("I", "length of a part", 4) for _ in self.blocks]
        checked = c.data[:c.pos]
        c.check(c.get("I", "CRC") == zlib.crc32(checked), "CRC of the lengths is wrong")
        c.check(sum(lengths) == len(c.data) - c.pos, "the lengths of the parts do not add up")
        self.parts = list(zip(itertools.accumulate(lengths, initial=begin + c.pos), lengths))

    def plain_entries(self, c):
        """A.5: lengths and means of all blocks in drafts 1 and 2."""
        count = len(self.blocks)
        w, v = c.get("B", "bytes per record length", 1, 4), c.get("B", "bytes per mean", 1, 4)
        c.get("H", "reserved field", 0, 0)
        lengths = c.bytes(count * w)
        lengths = [int.from_bytes(lengths[i:i + w], "little") for i in range(0, len(lengths), w)]
        c.bytes(2 * count)  # codes of the errors: for information
        means = c.bytes(count * self.channels * v)
        means = [int.from_bytes(means[i:i + v], "little", signed=True) for i in range(0, len(means), v)]
        return lengths, [means[i:i + self.channels] for i in range(0, len(means), self.channels)]

    def coded_entries(self, c):
        """3.6: lengths and means of all blocks."""
        coded = c.bytes(len(c.data) - c.pos)
        coder = RangeDecoder(coded, [32768] * (15 * 65))

        def number(index):
            ones, b = index * 65, 0
            while b < 32 and coder.bit(ones + b):
                b += 1
            return bits_below(coder, b, ones + 32 + b)

        def signed(v):
            return -(v + 1) // 2 if v & 1 else v // 2

        lengths, all_means = [], []
        length, rms, over, positions = 0, 0, 0, 1  # of the block before
        means, bits = [0] * self.channels, [0] * self.channels
        for _, shape in self.blocks:
            length = number(min(3, max(0, length.bit_length() - 3) // 2))
            rms = (rms + signed(number(4))) % 256  # for information, as is the largest code, (rms + over) % 256
            over = (over + signed(number(5))) % 256
            ratio = math.sqrt(math.prod(shape) / positions)
            positions = math.prod(shape)
            for t in range(self.channels):
                v = number(6 + 3 * min(t, 2) + min(2, bits[t] // 4))
                bits[t] = v.bit_length()
                p = min(max(away_from_zero(means[t] * ratio), -1 << 31), (1 << 31) - 1)
                means[t] = (p + signed(v) + (1 << 31)) % (1 << 32) - (1 << 31)
            lengths.append(length)
            all_means.append(list(means))
        c.check(coder.pos >= len(coded), "not all coded bytes are used")
        return lengths, all_means

    # --------------------------------------------------------------------------------------------- 4. The pipeline

    def block(self):
        """4.2: all blocks in order of their numbers, as (first position, shape)."""
        def cut(begin, lengths, piece):
            """Pieces of the box of these lengths, last axis fastest, short at the far edges."""
            for index in itertools.product(*(range(0, n, p) for n, p in zip(lengths, piece))):
                yield (tuple(b + i for b, i in zip(begin, index)),
                       tuple(min(p, n - i) for p, n, i in zip(piece, lengths, index)))

        for number, (begin, lengths) in zip(self.tile_shape_numbers, cut((0,) * 4, self.shape, self.tile)):
            yield from cut(begin, lengths, self.block_shapes[number])

    def record(self, number):
        """3.8, 4: one block: (log values [channel][axes] in f32, validity and exact zeros of the same shape)."""
        begin, length = self.records[number]
        data = self.data[begin:begin + length]
        c = Cursor(f"RECS, record {number}", data)
        c.check(length >= 5, "too short")
        crc = zlib.crc32(struct.pack("<I", number) + data[:-4])
        c.check(crc == int.from_bytes(data[-4:], "little"), "CRC is wrong")
        first_byte = c.get("B", "class of validity and doublings")
        validity_class, doublings = first_byte & 7, first_byte >> 3
        highest = MASK_PER_CHANNEL if self.draft < 5 else PRUNED  # A.6
        c.check(validity_class <= highest, f"class of validity {validity_class} is reserved")
        doubled = self.draft != 1 and self.ratio > 0 and validity_class != PRUNED  # 3.8, A.6
        c.check(doublings == 0 or doubled, f"{doublings} doublings of the sampling ratio")
        self.doublings[number] = doublings
        coded = c.bytes(length - 5)
        first, shape = self.blocks[number]
        valid = np.zeros((self.channels,) + shape, np.uint8)
        zero = np.zeros_like(valid)
        q = np.zeros((self.channels,) + shape, np.int64)
        coder = None
        if validity_class in (NONE, PRUNED):
            c.check(not coded, "coded bytes in a block without valid entries")
            if validity_class == PRUNED:
                self.pruned.add(number)
                if not self.allow_pruned:
                    raise Refused(f"{c.name}: block {number} was pruned")
        else:
            coder = RangeDecoder(coded, self.probabilities)
            valid[:] = masks(coder, validity_class, self.channels, *self.horizon(first, shape))
            if self.has_zeros:
                zero = exact_zeros(coder, valid)
            before = None
            for channel in range(self.channels):
                before = coefficients(coder, channel, shape, before, c, self.dependent)
                for place, value in before.values.items():
                    q[(channel,) + place] = value
        components = []
        for t in range(self.channels):
            s = dequantize(q[t], self.shrink, self.step[t])
            s[0, 0, 0, 0] = F32(self.means[number][t]) * self.step[t]
            components.append(synthesize_dft(s) if self.dft else synthesize_dct(s))
        if self.tables:
            components = [x + profile for x, profile in zip(components, self.grazing_profile(first, shape))]
        log = self.inverse_channel_transform(components)
        if coder:
            if self.correction > 0:
                correctable = valid * (zero == 0)
                log = log + corrections(coder, log, correctable, self.correction, c).astype(F32) * self.correction
            c.check(coder.pos >= len(coded), "not all coded bytes are used")
        return log, valid, zero

    def samples(self, number):
        """4.3: how many entries of each channel of a block are samples."""
        valid = self.record(number)[1].reshape(self.channels, -1)
        ratio = self.ratio << self.doublings[number]
        if ratio == 0 or ratio >= 1 << 32:
            return [int(mask.sum()) for mask in valid]
        counts = []
        for mask in valid:
            state = self.seed ^ number * 0xD1290B269C8B8C2D & MASK64
            state, free = splitmix64(state)[1], [int(p) for p in np.flatnonzero(mask)]
            available = len(free)
            for position in range(mask.size):
                state, output = splitmix64(state)
                if output >> 32 < ratio and free:
                    at = bisect.bisect_left(free, position)
                    del free[at if at < len(free) else 0]
            counts.append(available - len(free))
        return counts

    def inverse_channel_transform(self, x):
        """4.1."""
        if self.matrix is None:
            return np.stack(x)
        channels = []
        for c in range(self.channels):
            total = x[0] * self.matrix[0][c]
            for t in range(1, self.channels):
                total = total + x[t] * self.matrix[t][c]
            channels.append(total)
        return np.stack(channels)

    def inverse_tone_map(self, log):
        """4.1: (binary32 values, binary64 values)."""
        return (np.maximum(exp32(log) - F32(self.eps), F32(0)),
                np.maximum(exp64(log.astype(F64)) - F64(self.eps), F64(0)))

    def angle(self, axis, u):
        """3.2: the angles at coordinates u (f64) of an axis."""
        _, square, n, start, end = self.axes[axis]
        t = u / F64(n)
        return F64(start) + (F64(end) - F64(start)) * (t * t if square else t)

    def sincos(self, first, shape):
        """4.8, 4.10: (sines, cosines) at the centres of a block's bins of theta_h, theta_d and phi_d."""
        found = {}
        for axis in range(4):
            centres = np.arange(first[axis], first[axis] + shape[axis]).astype(F64) + F64(0.5)
            view = [-1 if i == axis else 1 for i in range(4)]
            found[self.axes[axis][0]] = [x.reshape(view) for x in sin_cos(self.angle(axis, centres))]
        return found["theta_h"], found["theta_d"], found["phi_d"]

    def grazing_profile(self, first, shape):
        """4.10: what is added to each component of a block."""
        (sin_h, cos_h), (sin_d, cos_d), (_, cos_p) = self.sincos(first, shape)
        middle, swing, c = (cos_h * cos_d).astype(F32), (sin_h * sin_d).astype(F32), cos_p.astype(F32)
        last = F32(self.knots - 1)
        h, d, _ = np.ogrid[:shape[1], :shape[2], :1]
        places = []  # of each side: k and f of all bins
        for z in (middle - swing * c, middle + swing * c):
            u = np.minimum(np.sqrt(np.maximum(z, F32(0)) * ((last * last) / self.zone)), last)[0]
            places.append((np.floor(u).astype(int), u - np.floor(u)))
        for t in range(self.channels):
            h_even, h_odd = (table[t][first[1]:first[1] + shape[1], None] for table in self.tables[:2])
            d_even, d_odd = (table[t][None, first[2]:first[2] + shape[2]] for table in self.tables[2:])
            even, odd = h_even + d_even, h_odd + d_odd
            sides = []
            for knots, (k, f) in zip((even + odd, even - odd), places):
                knots = np.concatenate([knots[..., :-1], np.zeros(knots.shape[:2] + (2,), F32)], axis=2)
                low, high = knots[h, d, k], knots[h, d, k + 1]
                sides.append(low + (high - low) * f)
            yield (sides[0] + sides[1])[None]

    def horizon(self, first, shape):
        """4.8: predicted validity and bands of the bins of a block."""
        if self.threshold is None:
            return np.ones(shape, np.uint8), np.full(shape, 7)
        (sin_h, cos_h), (sin_d, cos_d), (_, cos_p) = self.sincos(first, shape)
        elevation = np.broadcast_to(cos_h * cos_d - (sin_h * sin_d) * np.abs(cos_p), shape)
        d = elevation - F64(self.threshold)
        x = d / F64(0.01)
        band = np.where(d >= 0, np.floor(np.minimum(7.0, 4.0 + x)), np.minimum(3.0, np.floor(np.maximum(0.0, 4.0 + x))))
        return (elevation >= self.threshold).astype(np.uint8), band.astype(int)

    def values(self, number):
        """4.1, 4.9: one block: (binary32 values, binary64 values, validity)."""
        log, valid, zero = self.record(number)
        return *(np.where(zero, x.dtype.type(0), x) for x in self.inverse_tone_map(log)), valid

    def table(self):
        """4: the full table: binary32 values, binary64 values / scale, validity, each [channel][axes...]."""
        whole = (self.channels,) + self.shape
        values, scaled, valid = np.empty(whole, F32), np.empty(whole, F64), np.empty(whole, np.uint8)
        scale = np.array(self.scale, F64).reshape(-1, 1, 1, 1, 1)
        for number, (first, shape) in enumerate(self.blocks):
            here = (slice(None),) + tuple(slice(f, f + n) for f, n in zip(first, shape))
            values[here], wide, valid[here] = self.values(number)
            with np.errstate(over="ignore"):
                scaled[here] = np.minimum(wide / scale, sys.float_info.max)
        shape = (self.channels,) + self.shape[4 - self.naxes:]
        return values.reshape(shape), scaled.reshape(shape), valid.reshape(shape)

    def exact_values(self, number):
        """4.12: one block of a lossless file: (bits of the source values, validity), [channel][axes]."""
        if self.parts is None:
            self.exct()
        begin, length = self.parts[number]
        data = self.data[begin:begin + length]
        c = Cursor(f"EXCT, block {number}", data)
        coded = c.bytes(length - 4)
        c.check(zlib.crc32(struct.pack("<I", number) + coded) == c.get("I", "CRC"), "CRC is wrong")
        coder = RangeDecoder(coded, [32768] * X_CONTEXTS)
        _, values, valid = self.values(number)
        c.check(number not in self.pruned, "the block was pruned, source values need what its record held")
        bits = exact_bits(coder, values, valid, self.usual, self.scale, self.eps, c)
        c.check(coder.pos >= len(coded), "not all coded bytes are used")
        return bits, valid

    def exact_table(self):
        """4.12: the source values of the full table, binary64 [channel][axes...]."""
        bits = np.empty((self.channels,) + self.shape, np.uint64)
        for number, (first, shape) in enumerate(self.blocks):
            bits[(slice(None),) + tuple(slice(f, f + n) for f, n in zip(first, shape))] = self.exact_values(number)[0]
        return bits.reshape((self.channels,) + self.shape[4 - self.naxes:]).view(F64)


def probability(rank):
    """3.5: of a one, in 1/65536."""
    p = int(np.floor(F64(32768) * exp64(-(F64(abs(rank)) * F64(math.log(2) / 12))) + F64(0.5)))
    return p if rank <= 0 else 65536 - p


def cosines(p, n, w):
    """4.4: cos_turn(p, 4n) * w rounded to f32."""
    return (cos_turn(p, 4 * n) * w).astype(F32)


def synthesize_dct(s):
    """4.4 DCT-II."""
    for axis in (3, 2, 1, 0):
        n = s.shape[axis]
        if n == 1:
            continue
        k, i = np.arange(n)[:, None], np.arange(n)[None, :]
        T = cosines(k * (2 * i + 1), n, np.where(k == 0, math.sqrt(1 / n), math.sqrt(2 / n)))
        lines = np.moveaxis(s, axis, 0)
        out = np.empty_like(lines)
        for i in range((n + 1) // 2):
            parts = [np.zeros(lines.shape[1:], F32), np.zeros(lines.shape[1:], F32)]  # E, O
            for k in range(n):
                parts[k % 2] = parts[k % 2] + lines[k] * T[k, i]
            out[n - 1 - i] = parts[0] - parts[1]
            out[i] = parts[0] + parts[1]
        s = np.moveaxis(out, 0, axis)
    return s


def synthesize_dft(s):
    """4.4 DFT, steps 1 to 3."""
    shape = s.shape

    def index(f, n):
        """Where frequency f (0 to n - 1, wrapped) is stored."""
        return np.where(f == 0, 0, np.where(f <= n // 2, 2 * f - 1, 2 * (n - f)))

    # 1. unpack
    f = np.meshgrid(*(np.arange(n) for n in shape[:3]), np.arange(shape[3] // 2 + 1), indexing="ij")
    own = np.ravel_multi_index([index(g, n) for g, n in zip(f, shape)], shape)
    other = np.ravel_multi_index([index((n - g) % n, n) for g, n in zip(f, shape)], shape)
    flat, half = np.ascontiguousarray(s).ravel(), F32(math.sqrt(0.5))
    re = np.where(own == other, flat[own], flat[np.minimum(own, other)] * half)
    im = flat[np.maximum(own, other)] * half
    im = np.where(own == other, F32(0), np.where(own > other, -im, im))

    def waves(n):
        j = np.arange(n)[:, None] * np.arange(n)[None, :] % n
        return cosines(4 * j, n, math.sqrt(1 / n)), cosines(4 * j + 3 * n, n, math.sqrt(1 / n))

    # 2. the first three axes
    for axis in (2, 1, 0):
        n = shape[axis]
        if n == 1:
            continue
        cos, sin = waves(n)
        re, im = np.moveaxis(re, axis, 0), np.moveaxis(im, axis, 0)
        new_re, new_im = np.zeros(re.shape, F32), np.zeros(re.shape, F32)
        for i, f in itertools.product(range(n), range(n)):
            new_re[i] = new_re[i] + (re[f] * cos[f, i] - im[f] * sin[f, i])
            new_im[i] = new_im[i] + (re[f] * sin[f, i] + im[f] * cos[f, i])
        re, im = np.moveaxis(new_re, 0, axis), np.moveaxis(new_im, 0, axis)
    # 3. the last axis
    n = shape[3]
    cos, sin = waves(n)
    out = np.zeros(shape, F32)
    for i, f in itertools.product(range(n), range(n // 2 + 1)):
        m = F32(1 if f == 0 or 2 * f == n else 2)
        out[..., i] = out[..., i] + ((re[..., f] * m) * cos[f, i] - (im[..., f] * m) * sin[f, i])
    return out


def dequantize(q, shrink, step):
    """4.5."""
    magnitude = np.abs(q)
    less = np.where(magnitude == 1, F32(shrink[0]) / F32(256), F32(shrink[1]) / F32(256))
    value = (magnitude.astype(F32) - less) * step
    return np.where(q == 0, F32(0), np.where(q < 0, -value, value))


def away_from_zero(x):
    """3.6: the integer nearest to x, ties away from zero."""
    whole = math.floor(abs(x))
    return int(math.copysign(1, x)) * (whole + (abs(x) - whole >= 0.5))


MASK64 = (1 << 64) - 1


def splitmix64(state):
    """4.3: (next state, output)."""
    state = state + 0x9E3779B97F4A7C15 & MASK64
    z = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 & MASK64
    z = (z ^ z >> 27) * 0x94D049BB133111EB & MASK64
    return state, z ^ z >> 31


class Channel:
    """4.6, 4.11: what the next component or channel sees of this one: q, capped magnitudes (with dependent quantisation
    quantiser indices) and rows, each only where nonzero."""

    def __init__(self):
        self.values, self.m, self.rows = {}, Counter(), Counter()  # of places that are not there: 0


def coefficients(coder, component, shape, before, cursor, dependent=False):
    """4.6, steps 1 to 4: the coefficients of one component but the one at index 0; 4.5 if quantisation is dependent."""
    g, now = min(component, 2), Channel()
    if not coder.bit(ANY + g):  # 1
        return now
    extents = []  # 2
    for axis, n in enumerate(shape):
        b = (n - 1).bit_length()
        node = 1
        for _ in range(min(b, 4)):
            node = 2 * node + coder.bit(EXTENT + (g * 4 + axis) * 16 + node)
        value = (node - (1 << min(b, 4))) << (b - min(b, 4)) | coder.raw(b - min(b, 4))
        cursor.check(value < n, f"component {component}: extent {value + 1} of axis {axis} is above {n}")
        extents.append(value + 1)
    m, rows = now.m, now.rows
    for i, j, k in itertools.product(*map(range, extents[:3])):  # 3
        near = rows[i, j, k - 1] + rows[i, j - 1, k]
        around = rows[i, j - 1, k + 1] + rows[i - 1, j, k]
        sister = before.rows[i, j, k] if component else 2
        if not coder.bit(ROW + ((g * 3 + near) * 3 + around) * 3 + sister):
            continue
        rows[i, j, k] = 1
        state = 0  # 4.5: stays 0 without dependent quantisation
        for l in range(0 if i or j or k else 1, extents[3]):  # 4
            total = (2 * (m[i, j, k, l - 1] + m[i, j, k - 1, l] + m[i, j - 1, k, l])
                     + m[i, j, k, l - 2] + m[i, j, k - 1, l + 1] + m[i, j - 1, k, l + 1]
                     + m[i, j - 1, k + 1, l] + m[i - 1, j, k, l])
            sister = before.m[i, j, k, l] if component else 0
            place = min(3, 4 * (i + j + k + l) // sum(extents))
            significant = (D_SIGNIFICANT if state >= 2 else SIGNIFICANT) + ((g * 3 + min(sister, 2)) * 4 + place) * 12
            index = 0  # the quantiser index of 4.5; without dependent quantisation the magnitude
            if coder.bit(significant + level(total)):
                exponent = EXPONENT + (g * 8 + min(7, max(0, level(total + 3 * sister) - 3))) * 25
                index = 1 + number(coder, exponent, MANTISSA, cursor)
                magnitude = 2 * index - (state >= 2) if dependent else index
                cursor.check(magnitude <= 1 << 24, f"component {component}: a magnitude of more than 2^24")
                now.values[i, j, k, l] = -magnitude if coder.raw(1) else magnitude
                m[i, j, k, l] = min(255, index)
            if dependent:
                state = NEXT_STATE[state][index % 2]
    return now


def level(x):
    """4.6, step 4."""
    return LEVEL[x] if x < len(LEVEL) else 11


def number(coder, exponent, mantissa, cursor):
    """4.6, step 4: u, a magnitude or a quantiser index less 1; in 3.5 the number itself."""
    b = 0
    while coder.bit(exponent + b):
        b += 1
        cursor.check(b <= 24, "an exponent of more than 24 ones")
    u = min(b, 1)
    if b >= 2:
        u = bits_below(coder, b, mantissa + b)
    cursor.check(u < 1 << 24, "a magnitude of more than 2^24")
    return u


def corrections(coder, log, valid, step, cursor):
    """4.11: the corrections of a block, [channel][axes]; log values before correction."""
    shape = log.shape[1:]
    result = np.zeros(log.shape, np.int64)
    slope = np.zeros(log.shape, F32)  # the largest difference to the neighbours along axes 2 and 3
    for axis in (3, 4):
        difference = np.abs(np.diff(log, axis=axis))
        for skip in (slice(1, None), slice(None, -1)):
            part = slope[(slice(None),) * axis + (skip,)]
            np.maximum(part, difference, out=part)
    slope_class = sum((slope >= F32(t) * step).astype(int) for t in (0.25, 0.5, 1, 2))
    elder, sister = Channel(), Channel()
    any_before = 0
    for channel in range(len(log)):
        now = Channel()
        found = coder.bit(C_ANY + any_before)
        any_before = 1 + found
        rows, values = now.rows, now.m  # here m holds the corrections themselves
        for i, j, k in np.ndindex(*shape[:3]) if found else ():
            mask = valid[channel, i, j, k]
            if not mask.any():
                continue
            near = rows[i, j, k - 1] + rows[i, j - 1, k]
            if not coder.bit(C_ROW + near * 3 + (sister.rows[i, j, k] if channel else 2)):
                continue
            rows[i, j, k] = 1
            for l in np.flatnonzero(mask).tolist():
                left, above, front = values[i, j, k, l - 1], values[i, j, k - 1, l], values[i, j - 1, k, l]
                before, size = sister.m[i, j, k, l], min(2, abs(sister.m[i, j, k, l]))
                kind = [0, 1 + size, 4 + 2 * size + (elder.m[i, j, k, l] != 0)][min(channel, 2)]
                corrected = left != 0 or above != 0 or front != 0
                context = (kind * 5 + int(slope_class[channel, i, j, k, l])) * 2 + corrected
                if not coder.bit(C_PRESENT + context):
                    continue
                large = max(abs(left), abs(above), abs(front), abs(before)) >= 2
                magnitude = 1 + number(coder, C_EXPONENT + large * 25, C_MANTISSA, cursor)
                nearest = left or above or front
                sign = ((before > 0) - (before < 0) + 1) * 3 + (nearest > 0) - (nearest < 0) + 1
                values[i, j, k, l] = -magnitude if coder.bit(C_SIGN + sign) else magnitude
                result[channel, i, j, k, l] = values[i, j, k, l]
        elder, sister = sister, now
    return result


def bits_below(coder, b, mantissa):
    """3.6, 4.6: the number of b bits: the one after the leading one under a context, the others raw."""
    return b if b < 2 else (2 + coder.bit(mantissa)) << (b - 2) | coder.raw(b - 2)


class RangeDecoder:
    """4.7."""

    def __init__(self, data, probabilities):
        self.data, self.pos = data, 4
        self.fast, self.slow = list(probabilities), list(probabilities)
        self.range, self.code = (1 << 32) - 1, int.from_bytes(data[:4].ljust(4, b"\0"), "big")

    def normalize(self):
        while self.range < 1 << 24:
            self.range *= 256
            self.code = self.code * 256 + (self.data[self.pos] if self.pos < len(self.data) else 0)
            self.pos += 1

    def bit(self, context):
        fast, slow = self.fast[context], self.slow[context]
        bound = (self.range * max(1, (fast + slow) >> 1)) >> 16
        one = self.code < bound
        if one:
            self.range = bound
            self.fast[context], self.slow[context] = fast + ((65535 - fast) >> 4), slow + ((65535 - slow) >> 7)
        else:
            self.code -= bound
            self.range -= bound
            self.fast[context], self.slow[context] = fast - (fast >> 4), slow - (slow >> 7)
        self.normalize()
        return int(one)

    def raw(self, count):
        value = 0
        for _ in range(count):
            self.range >>= 1
            one = self.code < self.range
            if not one:
                self.code -= self.range
            self.normalize()
            value = 2 * value + one
        return value


def masks(coder, validity_class, channels, predicted, band):
    """4.8: validity, [channel][axes] or [axes]."""
    if validity_class in (ALL, HORIZON):
        return predicted if validity_class == HORIZON else np.ones_like(predicted)
    coded, before = [], predicted
    for _ in range(channels if validity_class == MASK_PER_CHANNEL else 1):
        mask = np.zeros_like(predicted)
        for i, j, k, l in np.ndindex(*predicted.shape):
            left = mask[i, j, k, l - 1] if l else predicted[i, j, k, l]
            above = mask[i, j, k - 1, l] if k else predicted[i, j, k, l]
            context = MASKS + band[i, j, k, l] * 8 + 4 * int(left) + 2 * int(above) + int(before[i, j, k, l])
            mask[i, j, k, l] = coder.bit(context)
        coded.append(mask)
        before = mask
    return np.stack(coded) if validity_class == MASK_PER_CHANNEL else coded[0]


def exact_zeros(coder, valid):
    """4.9: which entries are exactly zero, [channel][axes] as validity is."""
    zero, s = np.zeros_like(valid), 3
    for channel, mask in enumerate(valid):
        now, any_zero = zero[channel], coder.bit(ZEROS + s)  # 1
        all_zero = any_zero and coder.bit(ZEROS + 4 + s)  # 2
        s = any_zero + all_zero  # for the next channel
        if all_zero:
            now[:] = mask
        elif any_zero:  # 3
            for i, j, k, l in np.argwhere(mask):
                left, second = now[i, j, k, l - 1] if l else 0, now[i, j, k, l - 2] if l > 1 else 0
                above, front = now[i, j, k - 1, l] if k else 0, now[i, j - 1, k, l] if j else 0
                sister = zero[channel - 1, i, j, k, l] if channel else 0
                context = left + 2 * above + 4 * front + 8 * sister + 16 * second
                now[i, j, k, l] = coder.bit(ZEROS + 8 + int(context))
    return zero


def tree(coder, first, count):
    """4.12: a node, from 1, and below it bits high first, each under the context of the node above."""
    node = 1
    for _ in range(count):
        node = 2 * node + coder.bit(first + node)
    return node


def ordered(bits, w):
    """4.12: the map of w bits."""
    high = 1 << (w - 1)
    return bits ^ high if bits < high else bits ^ (2 * high - 1)


def against(coder, other, w, contexts, kind, cursor):
    """4.12: (number, length) of a number of w bits that is coded against another; contexts: those of the length."""
    length = tree(coder, contexts, 6) - 64
    cursor.check(length < w, f"{length} bits of a difference of {w} bits")
    d = min(length, 1)
    if length >= 2:
        top = min(3, length - 1)
        rest = length - 1 - top
        d = tree(coder, X_TOP + length * 8, top) << rest | coder.raw(rest)
    if coder.bit(X_SIGN + kind * 3 + min(2, length)):
        d = -1 - d
    mapped, high = (ordered(other, w) + d) % (1 << w), 1 << (w - 1)
    return mapped ^ high if mapped >= high else mapped ^ (2 * high - 1), length


def exact_bits(coder, values, valid, usual, scale, eps, cursor):
    """4.12: the bits of the source's values in a block, [channel][axes]; values binary64 in 1/sr."""
    as_bits, as_number = struct.Struct("<Q"), struct.Struct("<d")
    result = np.empty(values.shape, np.uint64)
    elder_errors, sister_errors, sister_lengths = {}, {}, {}  # of valid entries, by place
    for channel, (f, mask, s) in enumerate(zip(values, valid, scale)):
        now = result[channel]
        now[:] = usual[channel]
        missing = np.argwhere(mask == 0).tolist()  # 1
        if missing and not coder.bit(X_MISSING + min(channel, 2)):
            length = 0
            for place in missing:
                contexts = X_MISSING_LENGTH + 64 * (length > 0)
                now[tuple(place)], length = against(coder, usual[channel], 64, contexts, 1, cursor)
        errors, lengths = {}, {}
        if mask.any():
            per_sr, zeros, weighted = coder.raw(1), coder.raw(6), coder.raw(1)  # 2
            cursor.check(zeros <= 52, f"channel {channel}: {zeros} zeros")
            weights = [(coder.raw(8) ^ 128) - 128 if weighted else 0 for _ in range(8)]
            weighted = any(weights)
            weights = [weight / 64 for weight in weights]
            with np.errstate(over="ignore"):
                scaled = f if per_sr else np.minimum(f / F64(s), sys.float_info.max)
            e = eps if per_sr else min(eps / s, sys.float_info.max)
            last = 0  # the length coded last
            for i, j, k, l in np.argwhere(mask).tolist():
                p = predicted = float(scaled[i, j, k, l])
                if weighted and p > 0:  # 3
                    total = 0.0
                    around = [errors.get(place, 0.0) for place in (
                        (i, j, k, l - 1), (i, j, k - 1, l), (i, j - 1, k, l),
                        (i, j, k, l - 2), (i, j, k - 1, l - 1), (i, j, k - 1, l + 1))]
                    around += [before.get((i, j, k, l), 0.0) for before in (sister_errors, elder_errors)]
                    for q, weight in zip(around, weights):
                        total += q * weight
                    changed = p + (p + e) * total
                    if 0 < changed < math.inf:
                        predicted = changed
                level = (3 + lengths.get((i, j, k, l - 1), last) + lengths.get((i, j, k - 1, l), last)  # 4
                         + lengths.get((i, j - 1, k, l), last) + sister_lengths.get((i, j, k, l), last)) // 4
                other = as_bits.unpack(as_number.pack(predicted))[0] + (1 << zeros) // 2 >> zeros
                upper, last = against(coder, other, 64 - zeros, X_LENGTH + 64 * level, 0, cursor)
                lengths[i, j, k, l] = last
                now[i, j, k, l] = bits = upper << zeros
                x = as_number.unpack(as_bits.pack(bits))[0]
                error = (x - p) / (p + e) if p + e else math.nan
                errors[i, j, k, l] = error if abs(error) <= 1 else 0.0
            if per_sr:
                with np.errstate(all="ignore"):
                    x = now.view(F64)
                    now[:] = np.where((mask != 0) & ~np.isnan(x), (x / F64(s)).view(np.uint64), now)
        elder_errors, sister_errors, sister_lengths = sister_errors, errors, lengths
    return result


# ---------------------------------------------------------------------------------------------------------- command

def sums(file, exact):
    """The three CRC-32s of a file, in hexadecimal, and that of the source values if asked for."""
    for name in {b"META", b"RECS"} & set(file.sections):  # 3.1: the others have been checked
        file.section(name.decode())
    found = [f"{zlib.crc32(a.astype(t).tobytes()):08x}" for a, t in zip(file.table(), ("<f4", "<f8", "u1"))]
    if exact:
        found.append(f"{zlib.crc32(file.exact_table().view('u8').astype('<u8').tobytes()):08x}")
        file.section("EXCT")
    return found


def write_exact(file, path):
    """The source's values: MERL's form, three i32 and binary64 values [channel][axes], or NumPy's."""
    if not path.endswith(".binary"):
        np.save(path, file.exact_table())
        return
    names = [axis[0] for axis in file.axes]
    if names[1:] != ["theta_h", "theta_d", "phi_d"] or file.shape != (1, 90, 90, 180) or file.channels != 3:
        raise Refused("the table is not a MERL table; only these have the form .binary")
    bits = file.exact_table().view("u8").astype("<u8")
    with open(path, "wb") as f:
        f.write(struct.pack("<3i", *file.shape[1:]) + bits.tobytes())


def print_block(file, number, exact):
    """Positions [channel, axes...] and values of a block."""
    if not 0 <= number < len(file.blocks):
        raise Refused(f"there is no block {number}, only {len(file.blocks)}")
    values, valid = file.exact_values(number) if exact else file.values(number)[::2]
    pruned = ", pruned" if number in file.pruned else ""
    print("block {}: first position {}, shape {}{}".format(number, *file.blocks[number], pruned))
    for place in np.ndindex(*values.shape):
        shown = f"{values[place]:016x} {values[place].view(F64)!s}" if exact else f"{values[place]:.9g}"
        print(*place, shown, "valid" if valid[place] else "not valid")


def main():
    parser = argparse.ArgumentParser(description="Decode .csbrdf files.")
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--check", metavar="HASHES", help="compare the CRC-32s with this list")
    parser.add_argument("-o", metavar="OUT", help="write the binary32 values of one file (.npy)")
    parser.add_argument("--block", type=int, metavar="N", help="decode one block of one file, print its values")
    parser.add_argument("--samples", action="store_true", help="print the samples of each block, by channel")
    parser.add_argument("--exact", action="store_true", help="the source's bits, from a lossless file: with -o "
                        "(binary64 .npy, or .binary: MERL's form) or --block these, else their CRC-32 as well")
    parser.add_argument("--allow-pruned", action="store_true", help="decode pruned blocks too, as blocks without valid "
                        "entries, not an error; --check implies it")
    args = parser.parse_args()
    listed = {}
    if args.check:
        with open(args.check, encoding="utf-8") as f:
            listed = {line.split()[0]: line.split()[1:] for line in f if line.strip() and line[0] != "#"}
        args.files = args.files or [os.path.join(os.path.dirname(args.check), name) for name in listed]
    single = args.o is not None or args.block is not None
    if not args.files or single and len(args.files) != 1:
        parser.error("one file is needed" if single else "no file")
    bad = False
    for path in args.files:
        name = os.path.basename(path)
        try:
            with open(path, "rb") as f:
                file = File(f.read(), args.allow_pruned or bool(args.check))
            if args.o is not None and args.exact:
                write_exact(file, args.o)
            elif args.o is not None:
                np.save(args.o, file.table()[0])
            if args.block is not None:
                print_block(file, args.block, args.exact)
            if args.samples:
                print(name, [file.samples(number) for number in range(len(file.blocks))])
            if args.check or not single and not args.samples:
                found = sums(file, args.exact or len(listed.get(name, ())) > 3)
                same = not args.check or listed.get(name) == found
                bad |= not same
                print(name, *found, *(["ok" if same else "DIFFERS"] if args.check else []))
        except (Refused, OSError) as error:
            bad = True
            print(f"{name}: {error}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
