#!/usr/bin/env bash
# What takes longer than `.ci/run` may, or needs other compilers: run before a release.
#
#     tools/audit.sh [wasm] [threads] [addresses] [miri] [rust-version] [benches] [advisories] [parts] [reproducible]     # all of them without arguments
#
# wasm          golden files and look-ups as a WebAssembly module: tools/wasm.sh
# threads       tests/threads.rs under the thread sanitizer, the standard library included (nightly, rust-src)
# addresses     every fuzz target for a minute under the address sanitizer
# miri          unit tests of the decoder under Miri: a small block, the smallest golden files as a whole, without vector
#               instructions and with AVX2; not the map of a file, which Miri cannot make (nightly, miri; a quarter of an hour)
# rust-version  everything compiles with the oldest Rust that Cargo.toml names, the decoder alone with an older one but for x86-64
# benches       tools/bench, which has a criterion that nothing else needs, runs
# advisories    no crate with a licence or from a place that deny.toml does not allow, none that was yanked, and none with an advisory
#               against it, where the list of these can be had (cargo-deny, installed if it is missing: two minutes of a processor)
# parts         lists of all parts (SBOM): tools/sbom.sh
# reproducible  two builds give the same bytes: tools/reproducible.sh
#
# Toolchains come by rustup; what cannot be had is skipped, and says so.
set -euo pipefail
cd "$(dirname "$0")/.."
export CARGO_TERM_COLOR=never CARGO_INCREMENTAL=0 PROPTEST_FAILURE_PERSISTENCE=off
host=$(rustc -vV | sed -n 's/^host: //p')
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")/audit
[ $# -gt 0 ] || set -- wasm threads addresses miri rust-version benches advisories parts reproducible
skip() { echo "SKIPPED: $1: $2" >&2; }
component() { rustup component add --toolchain nightly "$@" >/dev/null 2>&1; }

for check in "$@"; do
    echo "== $check"
    case $check in
    wasm) tools/wasm.sh ;;
    threads)
        component rust-src || { skip threads "no nightly with rust-src"; continue; }
        RUSTFLAGS=-Zsanitizer=thread CARGO_TARGET_DIR=$target/threads cargo +nightly test -Zbuild-std --target "$host" --locked \
            --no-default-features --features mmap --test threads
        ;;
    addresses) SANITIZER=address fuzz/run.sh 60 ;;
    miri)
        component miri rust-src || { skip miri "no nightly with miri"; continue; }
        # Miri errs in the system's functions on purpose; the tests compare with them.
        export MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-deterministic-floats" PROPTEST_CASES=3
        # To Miri a processor has what the target has.
        flags=
        [ "${host%%-*}" != x86_64 ] || flags="-Ctarget-feature=+avx2,+fma"
        RUSTFLAGS=$flags CARGO_TARGET_DIR=$target/miri cargo +nightly miri test --locked -p csbrdf --no-default-features --lib
        ;;
    rust-version)
        oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
        rustup toolchain install "$oldest" --profile minimal >/dev/null 2>&1 || { skip rust-version "no Rust $oldest"; continue; }
        for manifest in Cargo.toml tools/cli/Cargo.toml tools/capi/Cargo.toml; do
            CARGO_TARGET_DIR=$target/oldest cargo "+$oldest" check --locked --manifest-path "$manifest" --all-targets
        done
        # The decoder alone does with what Debian has for tools/cross.sh, 1.85, wherever there is no AVX-512 to write for.
        target_flags="--profile minimal --target aarch64-unknown-linux-gnu"
        rustup toolchain install 1.85 $target_flags >/dev/null 2>&1 || { skip rust-version "no Rust 1.85"; continue; }
        CARGO_TARGET_DIR=$target/oldest cargo +1.85 check --locked --ignore-rust-version -p csbrdf --no-default-features --features unstable --lib --test golden \
            --target aarch64-unknown-linux-gnu
        ;;
    benches)
        cargo clippy --locked --manifest-path tools/bench/Cargo.toml --target-dir "$target/benches" --all-targets -- -D warnings
        cargo bench --locked --manifest-path tools/bench/Cargo.toml --target-dir "$target/benches" -- --test
        ;;
    advisories)
        command -v cargo-deny >/dev/null || cargo install cargo-deny --locked --quiet --debug || { skip advisories "no cargo-deny"; continue; }
        manifests=(Cargo.toml tools/cli/Cargo.toml tools/capi/Cargo.toml tools/python/Cargo.toml tools/bench/Cargo.toml fuzz/Cargo.toml)
        for manifest in "${manifests[@]}"; do
            cargo deny --locked --manifest-path "$manifest" --config "$PWD/deny.toml" check bans licenses sources
        done
        # What cargo says when it packs the crate.
        yanked=$(cargo package --locked -p csbrdf --allow-dirty --no-verify --target-dir "$target/package" 2>&1)
        if grep -i yanked <<<"$yanked"; then exit 1; fi
        cargo deny --locked --config "$PWD/deny.toml" fetch db || { skip advisories "the list of them cannot be had from GitHub here"; continue; }
        for manifest in "${manifests[@]}"; do
            cargo deny --locked --manifest-path "$manifest" --config "$PWD/deny.toml" check advisories
        done
        ;;
    parts) tools/sbom.sh ;;
    reproducible) tools/reproducible.sh ;;
    *) echo "no check of the name $check" >&2; exit 2 ;;
    esac
done
