#!/usr/bin/env bash
# Tests the plugin and renders small pictures from golden files, in the environment that ../python/run.sh makes (it is made
# if it is not there). Scalar variants need nothing else; llvm_ad_rgb needs LLVM's library, 16 or later: Debian's libllvm19,
# which is installed where that is allowed. PYTHON, VENV: as for ../python/run.sh. Arguments go to pytest.
set -euo pipefail
cd "$(dirname "$0")"
target=${CARGO_TARGET_DIR:-$PWD/../python/target}
venv=${VENV:-$target/venv}
export VENV=$venv
"$venv/bin/python" -c "from csbrdf import Importance" 2>/dev/null || ../python/run.sh -k "threads or errors"
"$venv/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt

# Older ones end the process on some of Dr.Jit's instructions.
llvm() { ldconfig -p | grep -oE 'libLLVM(-|\.so\.)(1[6-9]|[2-9][0-9])[^ ]*' | head -n 1; }
if [ -z "$(llvm)" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    { apt-get update -qq && apt-get install -qq --yes --no-install-recommends libllvm19; } >/dev/null || true
fi
variants=(scalar_rgb)
if [ -n "$(llvm)" ]; then variants+=(llvm_ad_rgb); else echo "no LLVM 16 or later: llvm_ad_rgb is not tested" >&2; fi
for variant in "${variants[@]}"; do
    echo "$variant"
    VARIANT=$variant "$venv/bin/python" -m pytest -q tests "$@"
done

pictures=$target/pictures
mkdir -p "$pictures"
golden=../../tests/data/v1
for name in dct-dependent dct-grazing-zeros; do
    PYTHONPATH=. "$venv/bin/python" tests/make_table.py "$golden/$name.csbrdf" "$pictures/$name.binary"
done
# The table is the file's, read by other code on a finer grid: the pictures are near each other, not the same.
"$venv/bin/python" render.py "$golden/dct-dependent.csbrdf" "$pictures/dct-dependent.binary" \
    --second "$golden/dct-grazing-zeros.csbrdf" "$pictures/dct-grazing-zeros.binary" \
    --size 64 --spp 16 --variant "${variants[-1]}" --out "$pictures" --at-least 50
