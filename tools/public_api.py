#!/usr/bin/env python3
"""The public items of the library, one a line: what a change of them is reviewed by.

    tools/public_api.py            # compares with docs/public-api.txt
    tools/public_api.py --write    # writes it anew

Types, functions, constants, traits and modules that a program can name, with their methods indented, of the default build and of what
the feature `encode` adds. From rustdoc's JSON, which the stable compiler gives with RUSTC_BOOTSTRAP=1.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "docs" / "public-api.txt"
KINDS = {"struct", "enum", "function", "constant", "trait", "module", "type_alias", "union", "macro", "static"}


def documented(features):
    """rustdoc's JSON of the library with some features."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    command = ["cargo", "rustdoc", "--quiet", "--locked", "-p", "csbrdf", "--lib", "--features", features, "--"]
    command += ["-Z", "unstable-options", "--output-format", "json"]
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "RUSTC_BOOTSTRAP": "1"})
    return json.loads((target / "doc" / "csbrdf.json").read_text())


def items(crate):
    """`path -> (kind, methods)` of all that can be named."""
    index, found = crate["index"], {}

    def methods(kind, inner):
        names = []
        for number in inner.get("impls", []):
            block = index[str(number)]["inner"]["impl"]
            if block["trait"] is None and not block["is_synthetic"]:
                held = (index[str(n)] for n in block["items"])
                names += [item["name"] for item in held if item["visibility"] == "public" and not hidden(item)]
        if kind == "trait":
            names += [index[str(n)]["name"] for n in inner["items"]]
        return sorted(names)

    def hidden(item):
        return any("doc(hidden)" in str(attribute) for attribute in item.get("attrs", []))

    def visit(number, path, name=None):
        item = index.get(str(number))
        if item is None or hidden(item):
            return
        (kind, inner), = item["inner"].items()
        if kind == "use":
            if inner["id"] is not None:
                visit(inner["id"], path, inner["name"])
            return
        if kind not in KINDS or item["visibility"] != "public":
            return
        own = path + [name or item["name"]]
        if len(own) > 1:
            found["::".join(own)] = (kind, methods(kind, inner))
        if kind == "module":
            for held in inner["items"]:
                visit(held, own)

    visit(crate["root"], [])
    return found


def main():
    plain = items(documented("mmap"))
    more = {path: what for path, what in items(documented("encode")).items() if plain.get(path) != what}
    lines = []
    for title, part in [("default", plain), ("with the feature encode, beside these", more)]:
        lines.append(f"# {title}: {len(part)} items")
        for path, (kind, methods) in sorted(part.items()):
            lines.append(f"{kind} {path}")
            lines += [f"    {name}" for name in methods]
        lines.append("")
    text = "\n".join(lines)
    if sys.argv[1:] == ["--write"]:
        LIST.write_text(text)
        return
    if LIST.read_text() != text:
        LIST.with_suffix(".new").write_text(text)
        sys.exit("the public items have changed: `tools/public_api.py --write` and have the change reviewed")
    print(f"{len(plain)} public items by default, {len(more)} more with the encoder")


main()
