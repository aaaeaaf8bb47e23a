"""What files that claim much, and damaged ones of them, cost each command: seconds of processors and peak MB.

    BOMBS=/tmp/bombs cargo test --release --lib -- --ignored write_bombs
    python3 tools/bombs.py target/release/csbrdf /tmp/bombs/*.csbrdf

A row a file, then the worst of each command, and per byte of the file. What takes longer than 20 s is ended.
"""

import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time

MOST = 20.0


def pairs(path, count):
    """Pairs of directions all over the hemisphere, neighbours far from each other."""
    with open(path, "w") as out:
        for i in range(count):
            z = 0.02 + 0.97 * ((i * 0.618034) % 1.0)
            x = (1 - z * z) ** 0.5
            w = 0.02 + 0.97 * ((i * 0.754878) % 1.0)
            y = (1 - w * w) ** 0.5
            print(x, 0, z, y * (-1) ** i, 0.01, w, file=out)


def measure(command):
    """Seconds of processors, peak MB and exit code of a command."""
    start = time.time()
    with open(os.devnull, "wb") as sink:
        child = subprocess.Popen(command, stdout=sink, stderr=sink)
        code = None
        while code is None:
            done, status, usage = os.wait4(child.pid, os.WNOHANG)
            if done:
                code = os.waitstatus_to_exitcode(status)
            elif time.time() - start > MOST:
                child.kill()
                _, _, usage = os.wait4(child.pid, 0)
                code = "ended"
            else:
                time.sleep(0.002)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000, code


def damage(file, to):
    """The file with the third byte from the end of its index changed: what takes most to mend."""
    shutil.copyfile(file, to)
    with open(to, "r+b") as damaged:
        head = damaged.read(32 + 20 * 64)
        at = 32 + 20 * struct.unpack_from("<H", head, 14)[0]
        for entry in range(32, at, 20):
            name, _, length, _ = struct.unpack_from("<4sIQI", head, entry)
            if name == b"INDX" and length > 2:
                damaged.seek(at + length - 3)
                byte = damaged.read(1)
                damaged.seek(at + length - 3)
                damaged.write(bytes([byte[0] ^ 0x5A]))
                return
            at += length


def commands(tool, file, folder):
    out, damaged = os.path.join(folder, "out"), os.path.join(folder, "damaged.csbrdf")
    damage(file, damaged)
    return {
        "info": [tool, "info", file],
        "info --blocks": [tool, "info", "--blocks", file],
        "info --json --blocks": [tool, "info", "--json", "--blocks", file],
        "decode --block": [tool, "decode", "--block", "0", file, "--coarse", "-f", "-o", out + ".npy"],
        "eval": [tool, "eval", file, "--coarse", "--pairs", os.path.join(folder, "pairs")],
        "lint": [tool, "lint", file],
        "prune": [tool, "prune", file, "--channels", "0", "--detail", "0.1", "-f", "-o", out + ".csbrdf"],
        "render": [tool, "render", file, "--coarse", "-f", "-o", out + ".png", "--size", "64", "--samples", "16"],
        "verify": [tool, "verify", file],
        "decode": [tool, "decode", file, "--coarse", "-f", "-o", out + ".npy", "--fill"],
        "compare": [tool, "compare", file, file],
        "repair": [tool, "repair", damaged, "-f", "-o", out + ".csbrdf"],
        "salvage": [tool, "decode", damaged, "--salvage", "-f", "-o", out + ".npy"],
    }


def main():
    tool, *files = sys.argv[1:]
    only = os.environ.get("ONLY", "").split(",") if os.environ.get("ONLY") else None
    worst = {}
    with tempfile.TemporaryDirectory() as folder:
        pairs(os.path.join(folder, "pairs"), 1000)
        for file in files:
            length, cells = os.path.getsize(file), []
            for name, command in commands(tool, file, folder).items():
                if only and name not in only:
                    continue
                seconds, peak, code = measure(command)
                cells.append(f"{name} {seconds:.2f} s {peak:.0f} MB ({code})")
                worst.setdefault(name, []).append((seconds, peak, length, os.path.basename(file)))
            print(f"{os.path.basename(file)} ({length}): " + ", ".join(cells), flush=True)
    print("\n| command | worst s | file | worst MB | file | us a byte | kB a byte |\n| --- | --- | --- | --- | --- | --- | --- |")
    for name, rows in worst.items():
        by_time, by_memory = max(rows), max(rows, key=lambda row: row[1])
        each = max(row[0] / row[2] for row in rows), max(row[1] / row[2] for row in rows)
        print(
            f"| {name} | {by_time[0]:.2f} | {by_time[3]} | {by_memory[1]:.0f} | {by_memory[3]} "
            f"| {each[0] * 1e6:.0f} | {each[1] * 1e3:.1f} |"
        )


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    main()
