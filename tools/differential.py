#!/usr/bin/env python3
"""Compares spec/decode.py, which was written from the specification alone, with the Rust decoder on changed files: values, validity,
samples, source values, and what is refused. Changed are fields of golden files, with right lengths and checksums (fuzz/src/bodies/recipe.rs).

    CSBRDF_DIFFERENTIAL=DIR cargo test --test crashes -- --ignored files_for    # writes files and verdicts; README of fuzz/
    tools/differential.py DIR                                                   # exit 1 on a disagreement

Needs NumPy.
"""
import collections
import multiprocessing
import pathlib
import sys
import time
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "spec"))
from decode import File, Refused  # spec/decode.py


def crc(array, kind):
    return f"{zlib.crc32(array.astype(kind).tobytes()):08x}"


def of_block(file, number):
    """Values, validity, source values, counts of samples; `-` if refused."""
    try:
        values, _, valid = file.values(number)
    except Refused:
        return "-"
    try:
        exact = crc(file.exact_values(number)[0], "<u8")
    except Refused:
        exact = "-"
    sampled = ",".join(str(count) for count in file.samples(number))
    return f"{crc(values, '<f4')}/{crc(valid, 'u1')}/{exact}/{sampled}"


def verdict(data):
    """As fuzz/src/bodies/differential.rs words it, and why if the file is refused."""
    try:
        file = File(data, allow_pruned=True)
    except Refused as refused:
        return "refused", str(refused)
    blocks = [of_block(file, number) for number in range(len(file.blocks))]
    if all(block == "-" for block in blocks):
        return "refused", "no block"
    table = "-"
    if "-" not in blocks:
        _, scaled, valid = file.table()
        table = f"{crc(scaled, '<f8')}/{crc(valid, 'u1')}"
    return " ".join([table, *blocks]), ""


def compare(work):
    """None if both agree, otherwise what each says."""
    path, expected = work
    try:
        found, why = verdict(path.read_bytes())
    except Exception as error:  # a fault of this decoder, to be named with its file
        found, why = "fails", f"{type(error).__name__}: {error}"
    return (path.name, expected, found, why)


def main(folder):
    begin = time.time()
    lines = (folder / "verdicts.txt").read_text().splitlines()
    listed = dict(line.split(" ", 1) for line in lines)
    # Beyond the limits that the other side was given there is nothing to compare.
    work = [(folder / name, said) for name, said in listed.items() if said != "limit"]
    with multiprocessing.Pool() as pool:
        kinds, differ = collections.Counter(), []
        for name, expected, found, why in pool.imap_unordered(compare, work, chunksize=4):
            kinds["refused" if expected == "refused" else "some blocks" if " -" in f" {expected}" else "decoded"] += 1
            if found != expected:
                differ.append(name)
                print(f"{name}: DIFFERS {why}\n  Rust   {expected[:400]}\n  Python {found[:400]}", flush=True)
    print(f"{len(work)} files compared ({', '.join(f'{n} {kind}' for kind, n in sorted(kinds.items()))}), "
          f"{len(listed) - len(work)} beyond limits, {len(differ)} differ, {time.time() - begin:.1f} s")
    return 1 if differ or not work else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1])))
