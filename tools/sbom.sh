#!/usr/bin/env bash
# A list of all parts (SBOM) of what is shipped: the tool and library, the C ABI, the Python package. CycloneDX 1.5, JSON, by
# cargo-cyclonedx, which is installed if it is missing (two minutes of a processor).
#
#     tools/sbom.sh [FOLDER]        # target/sbom
#
# One file a package: crates with version, licence, checksum and what they need, for the features that are shipped. It has no
# serial number, and the time of the commit: the same sources give the same list.
set -euo pipefail
cd "$(dirname "$0")/.."
export CARGO_TERM_COLOR=never
out=$(realpath -m "${1:-${CARGO_TARGET_DIR:-target}/sbom}")
mkdir -p "$out"
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || echo 0)}
export SOURCE_DATE_EPOCH
command -v cargo-cyclonedx >/dev/null || cargo install cargo-cyclonedx --locked --quiet --debug

for manifest in Cargo.toml tools/cli/Cargo.toml tools/capi/Cargo.toml tools/python/Cargo.toml; do
    # Versions are those of the lock file, or this fails.
    cargo metadata --locked --format-version 1 --manifest-path "$manifest" >/dev/null
    # It writes beside the manifest.
    cargo cyclonedx --quiet --manifest-path "$manifest" --format json --spec-version 1.5 --no-build-deps --target all \
        --override-filename sbom
    name=$(sed -n 's/^name = "\(.*\)"/\1/p' "$manifest" | head -n 1)
    mv "$(dirname "$manifest")/sbom.json" "$out/$name.cdx.json"
done

python3 - "$out" <<'PYTHON'
import json, pathlib, sys
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.cdx.json")):
    # Packages of this repository are named by their folder on this machine.
    bom = json.loads(path.read_text().replace(pathlib.Path.cwd().as_uri(), "file:///csbrdf"))
    bom.pop("serialNumber", None)
    assert bom["bomFormat"] == "CycloneDX" and bom["components"], path
    unknown = [c["name"] for c in bom["components"] if not c.get("licenses")]
    assert not unknown, f"{path.name}: no licence of {unknown}"
    path.write_text(json.dumps(bom, indent=2) + "\n")
    print(f"{path}: {len(bom['components'])} components")
PYTHON
