#!/usr/bin/env bash
# The decoder where there are no files, maps or threads: the C ABI as a WebAssembly module (wasm32-unknown-unknown), which decodes
# every golden file and looks values up in it, compared with the checksums of tests/data/v1. The module runs in wasmtime (PyPI).
#
#     tools/wasm.sh
#
# Needs Rust's standard library for wasm32 (`rustup target add wasm32-unknown-unknown`; it is tried here) and python3.
set -euo pipefail
cd "$(dirname "$0")/.."
export CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-target}")
target=$CARGO_TARGET_DIR
if ! rustup target list --installed | grep -qx wasm32-unknown-unknown && ! rustup target add wasm32-unknown-unknown; then
    echo "SKIPPED: no standard library for wasm32 here" >&2
    exit 0
fi
cargo build --manifest-path tools/capi/Cargo.toml --release --locked --target wasm32-unknown-unknown
[ -x "$target/wasm-venv/bin/python" ] || python3 -m venv "$target/wasm-venv"
"$target/wasm-venv/bin/pip" install --quiet --disable-pip-version-check "wasmtime>=20,<100"
"$target/wasm-venv/bin/python" tools/wasm.py "$target/wasm32-unknown-unknown/release/csbrdf.wasm" tests/data/v1
