#!/usr/bin/env bash
# Builds the library, compiles the C and C++ programs against it (shared and static), runs them.
# CHECK=valgrind runs them under valgrind, CHECK=asan compiles them with the address and undefined-behaviour sanitizers.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
cargo build --release --locked
mkdir -p "$target/smoke"
target=$(cd "$target" && pwd)
release=$target/release

run=() flags=()
case ${CHECK:-} in
valgrind) run=(valgrind --quiet --error-exitcode=9 --leak-check=full --show-leak-kinds=definite,indirect,possible) ;;
asan) flags=(-g -fsanitize=address,undefined -fno-sanitize-recover=all) ;;
"") ;;
*) echo "CHECK is valgrind, asan or empty, not $CHECK" >&2; exit 2 ;;
esac
warnings=(-Wall -Wextra -Werror -pedantic)
# What the Rust library itself needs; `cargo rustc --release -- --print native-static-libs` lists it.
case $(uname) in
Darwin) system=(-liconv -lSystem -lc -lm) ;;
*) system=(-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc) ;;
esac

"${CC:-cc}" -std=c99 -O2 "${warnings[@]}" ${flags[@]+"${flags[@]}"} -Iinclude tests/smoke.c -o "$target/smoke/c" \
    -L"$release" -lcsbrdf -Wl,-rpath,"$release" -lm
"${CXX:-c++}" -std=c++17 -O2 "${warnings[@]}" ${flags[@]+"${flags[@]}"} -Iinclude tests/smoke.cpp \
    -o "$target/smoke/cpp" "$release/libcsbrdf.a" "${system[@]}"
${run[@]+"${run[@]}"} "$target/smoke/c" ../../tests/data/v1
${run[@]+"${run[@]}"} "$target/smoke/cpp" ../../tests/data/v1
