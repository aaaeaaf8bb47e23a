#!/usr/bin/env bash
# Decoding and evaluation give the same bits on other machines: tests of the decoder alone (its unit tests and tests/golden.rs) on
# x86-64, on x86-64 with AVX2 and no more, on x86-64 without AVX2, on aarch64 and on s390x, which is big-endian. All but the first run
# under qemu's user mode.
#
#     tools/cross.sh [options of cargo test, as --release]
#
# For x86-64 Debian (12 or later; elsewhere with apt-get, dpkg-deb and debian-archive-keyring). Needs neither root nor a foreign
# architecture in dpkg: packages of Debian 12 are unpacked into a folder of their own, CSBRDF_CROSS or target/cross-root (1.4 GB).
# Their rustc is 1.85, older than what the crate as a whole asks for; the decoder alone must do without what came later.
#
# | machine | byte order | rustc | tests passed | failed | lines of checksums: their SHA-256 |
# | --- | --- | --- | --- | --- | --- |
# | x86-64 | little | 1.95.0 | 76 | 0 | 65: 3b4d2eaf |
# | x86-64-with-avx2 | little | 1.95.0 | 76 | 0 | 65: 3b4d2eaf |
# | x86-64-without-avx2 | little | 1.95.0 | 76 | 0 | 65: 3b4d2eaf |
# | aarch64 | little | 1.85.0 | 76 | 0 | 65: 3b4d2eaf |
# | s390x | big | 1.85.0 | 76 | 0 | 65: 3b4d2eaf |
set -euo pipefail
cd "$(dirname "$0")/.."
root=$(realpath -m "${CSBRDF_CROSS:-target/cross-root}")
export CARGO_TERM_COLOR=never PROPTEST_FAILURE_PERSISTENCE=off

packages=(
    # The compiler, its LLVM and what that links to.
    rustc-web libstd-rust-web-1.85 libllvm19 libz3-4 libxml2 libicu72 libedit2 libbsd0 libmd0 libffi8
    # Standard libraries: amd64 for build scripts.
    libstd-rust-web-dev:{amd64,arm64,s390x}
    # Linkers, C libraries, emulators.
    {gcc-12,binutils}-{aarch64,s390x}-linux-gnu lib{c6,c6-dev,gcc-s1,gcc-12-dev}-{arm64,s390x}-cross qemu-user-static
)

# An apt of its own, with an empty dpkg status, so that nothing of this machine matters or changes.
fetch() {
    local apt=$root.part/apt
    mkdir -p "$apt/lists/partial" "$apt/archives/partial" "$apt/debs"
    : >"$apt/status"
    echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian bookworm main" >"$apt/list"
    cat >"$apt/conf" <<CONF
APT::Architecture "amd64"; APT::Architectures { "amd64"; "arm64"; "s390x"; }; APT::Sandbox::User "";
Dir::State "$apt"; Dir::State::status "$apt/status"; Dir::Cache "$apt";
Dir::Etc::SourceList "$apt/list"; Dir::Etc::SourceParts "/dev/null";
Acquire::Languages "none";
CONF
    export APT_CONFIG=$apt/conf
    apt-get -qq update
    (cd "$apt/debs" && apt-get -qq download "${packages[@]}")
    for deb in "$apt"/debs/*.deb; do dpkg-deb --extract "$deb" "$root.part"; done
    rm -r "$apt"
    mv "$root.part" "$root"
}

# row MACHINE BYTE-ORDER [cargo's options]: runs the tests, prints a row of the table.
row() {
    local machine=$1 order=$2 log=target/cross/$1.log sums=target/cross/$1.sums passed failed same=""
    shift 2
    echo "$machine ..." >&2
    cargo test --locked -p csbrdf --no-default-features --features unstable --lib --test golden --no-fail-fast "$@" -- --show-output >"$log" 2>&1 || bad=1
    # What the golden tests found: file and checksums.
    grep -E '^[a-z0-9-]+\.csbrdf( [0-9a-f]{8})+$' "$log" | sort >"$sums" || true
    passed=$(awk '/^test result/ { n += $4 } END { print n + 0 }' "$log")
    failed=$(awk '/^test result/ { n += $6 } END { print n + 0 }' "$log")
    cmp -s "$sums" target/cross/x86-64.sums || { same=", NOT as on x86-64" bad=1; }
    printf '| %s | %s | %s | %s | %s | %s: %s%s |\n' "$machine" "$order" "$("${RUSTC:-rustc}" --version | cut -d' ' -f2)" \
        "$passed" "$failed" "$(wc -l <"$sums")" "$(sha256sum <"$sums" | cut -c1-8)" "$same"
}

[ -d "$root" ] || fetch >&2
rm -rf target/cross
mkdir -p target/cross
bad=0
echo "| machine | byte order | rustc | tests passed | failed | lines of checksums: their SHA-256 |"
echo "| --- | --- | --- | --- | --- | --- |"
row x86-64 little "$@"
export CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER="$root/usr/bin/qemu-x86_64-static -cpu Haswell"
row x86-64-with-avx2 little "$@"
export CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER="$root/usr/bin/qemu-x86_64-static -cpu Nehalem"
row x86-64-without-avx2 little "$@"

export RUSTC=$root/usr/bin/rustc LD_LIBRARY_PATH=$root/usr/lib/x86_64-linux-gnu PATH=$root/usr/bin:$PATH
for machine in aarch64 s390x; do
    target=CARGO_TARGET_${machine^^}_UNKNOWN_LINUX_GNU
    export "${target}_LINKER=$machine-linux-gnu-gcc-12" "${target}_RUSTFLAGS=-Clink-arg=--sysroot=$root"
    export "${target}_RUNNER=qemu-$machine-static -L $root/usr/$machine-linux-gnu"
done
unset CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER
row aarch64 little --target aarch64-unknown-linux-gnu --ignore-rust-version "$@"
row s390x big --target s390x-unknown-linux-gnu --ignore-rust-version "$@"
[ $bad = 0 ] || { echo "see target/cross/*.log" >&2; exit 1; }
