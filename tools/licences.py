"""Licences and sources of all crates that the given packages depend on, held to deny.toml: what `cargo deny` says of them, where
it is not at hand. Needs Python 3.11.

usage: licences.py Cargo.toml...
"""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path


def allowed(expression, licences):
    """Whether an SPDX expression (`/` is an old `OR`) can be met; AND binds closer than OR."""
    tokens = re.findall(r"[()]|[^()\s]+(?: WITH \S+)?", expression.replace("/", " OR "))

    def term():
        token = tokens.pop(0)
        if token != "(":
            return token in licences
        value = either()
        tokens.pop(0)
        return value

    def both():
        value = term()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            value = term() and value
        return value

    def either():
        value = both()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            value = both() or value
        return value

    return either()


def main(manifests):
    rules = tomllib.loads(Path(__file__).parent.with_name("deny.toml").read_text())["licenses"]
    exceptions = {rule["crate"]: set(rule["allow"]) for rule in rules["exceptions"]}
    crates, bad = set(), set()
    for manifest in manifests:
        command = ["cargo", "metadata", "--locked", "--format-version", "1", "--manifest-path", manifest]
        for package in json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["packages"]:
            if package["source"] is None:
                continue
            name = f"{package['name']} {package['version']}"
            crates.add(name)
            if not allowed(package["license"] or "none", set(rules["allow"]) | exceptions.get(package["name"], set())):
                bad.add(f"{name}: licence {package['license']}")
            if package["source"] != "registry+https://github.com/rust-lang/crates.io-index":
                bad.add(f"{name}: from {package['source']}")
    print(f"{len(crates)} crates", *sorted(bad), sep="\n")
    return 1 if bad or not crates else 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
