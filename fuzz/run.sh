#!/usr/bin/env bash
# Builds all targets at once and runs each for so many seconds, or only those that are named:
#     run.sh SECONDS [TARGET...]
# SANITIZER=address (here none), as `cargo fuzz` knows it. FUZZ_SEED=N (here any): the same inputs in the same order. DECODER=1 leaves
# out what encodes and the command line: most of the compiler's time. Says of each how many inputs it ran; fails at the first crash.
set -euo pipefail
cd "$(dirname "$0")"
export RUSTC_BOOTSTRAP=1
seconds=${1:?seconds for each target}
shift
# Longest input: a golden file with a head before it, or what the target can make use of.
declare -A longest=([block]=4096 [repair]=32 [structured]=64 [prune]=64 [trace]=1024 [encode]=1536 [merl]=64 [samples]=2048 [args]=512 [manifest]=8192)

# The reader is the one that everybody has, checksums and all: bodies put them right (src/bodies/seal.rs).
# Comparisons are not traced: that takes more time than the codec, and there is no checksum to guess.
build=(--sanitizer "${SANITIZER:-none}" --codegen-units 16 --no-trace-compares --no-cfg-fuzzing)
targets=("$@")
if [ -n "${DECODER:-}" ]; then
    build+=(--no-default-features)
    [ $# -gt 0 ] || targets=(open block file eval stale salvage structured trace merl capi)
fi
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cargo fuzz list)
./seeds.sh
cargo fuzz build "${build[@]}"
for target in "${targets[@]}"; do
    printf '%-8s' "$target"
    log=$(mktemp)
    cargo fuzz run "${build[@]}" "$target" -- -max_total_time="$seconds" -max_len="${longest[$target]:-16384}" \
        -rss_limit_mb=2048 -timeout=30 -print_final_stats=1 -seed="${FUZZ_SEED:-0}" >"$log" 2>&1 || { tail -n 40 "$log"; exit 1; }
    sed -n 's/^stat::number_of_executed_units: */ inputs /p; s/^stat::slowest_unit_time_sec: */ slowest, s /p' "$log" |
        tr -d '\n'
    grep -oE ' cov: [0-9]+' "$log" | tail -n 1
    rm "$log"
done
