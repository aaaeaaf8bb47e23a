#!/usr/bin/env bash
# Builds the wheel, installs it into a virtual environment of its own, runs the tests on it.
# PYTHON chooses the interpreter (python3), VENV the environment; arguments go to pytest.
set -euo pipefail
cd "$(dirname "$0")"
target=${CARGO_TARGET_DIR:-$PWD/target}
venv=${VENV:-$target/venv}
test -x "$venv/bin/python" || "${PYTHON:-python3}" -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt
wheels=$target/wheels
rm -rf "$wheels"
"$venv/bin/maturin" build --quiet --release --locked --interpreter "$venv/bin/python" --target-dir "$target" --out "$wheels"
"$venv/bin/pip" install --quiet --disable-pip-version-check --force-reinstall --no-deps "$wheels"/csbrdf-*.whl
"$venv/bin/python" -m pytest -q "$@"
