#!/usr/bin/env bash
# Two builds of the tool from the sources of the last commit, in different folders, give the same bytes: prints their SHA-256.
#
#     tools/reproducible.sh [COMMIT]
#
# Who wants to check a release builds its commit with the same Rust on the same target, and compares. Folders are written as /csbrdf and
# /cargo; nothing else of the machine goes into the program: dependencies are those of Cargo.lock, the time is that of the commit.
set -euo pipefail
cd "$(dirname "$0")/.."
commit=$(git rev-parse --short "${1:-HEAD}")
[ -z "$(git status --porcelain --untracked-files=no)" ] || echo "note: changes that are not committed are not in it" >&2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct "$commit")
export SOURCE_DATE_EPOCH CARGO_TERM_COLOR=never CARGO_INCREMENTAL=0 LC_ALL=C TZ=UTC
unset CARGO_BUILD_RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_TARGET_DIR
cargo=$(realpath "${CARGO_HOME:-$HOME/.cargo}")

sums=()
for folder in "$work/one" "$work/another/and/deeper"; do
    mkdir -p "$folder"
    git archive "$commit" | tar -x -C "$folder"
    # Paths in messages of panics; in what the C compiler makes of zstd.
    export RUSTFLAGS="--remap-path-prefix=$folder=/csbrdf --remap-path-prefix=$cargo=/cargo"
    export CFLAGS="-ffile-prefix-map=$folder=/csbrdf -ffile-prefix-map=$cargo=/cargo"
    (cd "$folder" && cargo build --quiet --release --locked --bin csbrdf)
    sums+=("$(sha256sum <"$folder/target/release/csbrdf" | cut -d' ' -f1)")
    if grep -aqF -e "$folder" -e "$cargo" "$folder/target/release/csbrdf"; then
        echo "the program names $folder or $cargo" >&2
        exit 1
    fi
    bytes=$(stat -c %s "$folder/target/release/csbrdf")
    rm -rf "$folder/target"
done
echo "commit $commit, $(rustc --version), $(rustc -vV | sed -n 's/^host: //p'), $bytes bytes"
printf '%s\n' "${sums[@]}"
[ "${sums[0]}" = "${sums[1]}" ] || { echo "the two builds differ" >&2; exit 1; }
