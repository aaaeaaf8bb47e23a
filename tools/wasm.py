"""Decodes the golden files with the WebAssembly module that tools/wasm.sh builds, and compares checksums.

usage: wasm.py MODULE FOLDER, the folder with hashes.txt and eval.txt
"""

import struct
import sys
import zlib
from pathlib import Path

import wasmtime

OPTIONS = struct.Struct("<5I")  # csbrdf_options: size_t is four bytes here
LOOKUPS = (0, 1)  # linear, nearest: the columns of eval.txt


class Module:
    """An instance of the module; what is put into its memory stays there."""

    def __init__(self, path):
        self.store = wasmtime.Store()
        instance = wasmtime.Instance(self.store, wasmtime.Module.from_file(self.store.engine, path), [])
        self.exports = instance.exports(self.store)
        self.memory = self.exports["memory"]

    def call(self, name, *arguments):
        status = self.exports[name](self.store, *arguments)
        if status:
            place = self.allocate(512)
            length = self.exports["csbrdf_last_error"](self.store, place, 512)
            raise RuntimeError(f"{name}: status {status}: {self.read(place, min(length, 511)).decode()}")

    def allocate(self, size):
        """Room at the end of the memory, which the module itself never uses."""
        pages = (size + 0xFFFF) // 0x10000 + 1
        return self.memory.grow(self.store, pages) * 0x10000

    def place(self, data):
        place = self.allocate(len(data))
        self.memory.write(self.store, data, place)
        return place

    def read(self, place, size):
        return bytes(self.memory.read(self.store, place, place + size))

    def number(self, name, handle):
        place = self.allocate(4)
        self.call(name, handle, place)
        return struct.unpack("<I", self.read(place, 4))[0]

    def open(self, data, lookup):
        options = self.place(OPTIONS.pack(OPTIONS.size, 0, 0, lookup, 1))
        out = self.allocate(4)
        self.call("csbrdf_open_memory_with", self.place(data), len(data), options, out)
        return struct.unpack("<I", self.read(out, 4))[0]

    def table(self, handle):
        count = self.number("csbrdf_table_size", handle)
        out = self.allocate(4 * count)
        self.call("csbrdf_decode_all", handle, out, count)
        return zlib.crc32(self.read(out, 4 * count))

    def values(self, handle, directions):
        channels = self.number("csbrdf_channel_count", handle)
        count = len(directions) // 2
        wi, wo = (self.place(struct.pack(f"<{3 * count}d", *(x for d in directions[i::2] for x in d))) for i in (0, 1))
        out = self.allocate(4 * channels * count)
        self.call("csbrdf_eval_many", handle, count, wi, wo, out, channels * count)
        return zlib.crc32(self.read(out, 4 * channels * count))


def directions():
    """Pairs of them one after the other: those of tests/golden.rs."""
    mask = (1 << 64) - 1
    state = 2013

    def uniform():
        nonlocal state
        state = state + 0x9E3779B97F4A7C15 & mask
        z = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 & mask
        z = (z ^ z >> 27) * 0x94D049BB133111EB & mask
        return ((z ^ z >> 31) >> 11) / (1 << 53)

    random = [(2 * uniform() - 1, 2 * uniform() - 1, 1.125 * uniform() - 0.125) for _ in range(1000)]
    edges = [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1e-200, 0.0, 1e-200), (3e300, -4e300, 1e299)]
    return random + [direction for a in edges for b in edges for direction in (a, b)]


def sums(path):
    lines = (line.split() for line in path.read_text().splitlines() if line and not line.startswith("#"))
    return {name: [int(field, 16) for field in fields] for name, *fields in lines}


def main(module, folder):
    folder = Path(folder)
    tables, values = sums(folder / "hashes.txt"), sums(folder / "eval.txt")
    pairs = directions()
    wrong = 0
    for name, expected in tables.items():
        decoder = Module(module)
        data = (folder / name).read_bytes()
        handles = [decoder.open(data, lookup) for lookup in LOOKUPS]
        found = [decoder.table(handles[0])]
        wanted = expected[:1]
        if name in values:
            found += [decoder.values(handle, pairs) for handle in handles]
            wanted = wanted + values[name]
        wrong += found != wanted
        print(name, *(f"{crc:08x}" for crc in found), "" if found == wanted else "DIFFERS")
    print(f"{len(tables)} files, {wrong} differ")
    return 1 if wrong or not tables else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
