"""The golden files of the format, and the independent decoder as a module."""
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
GOLDEN = ROOT / "tests" / "data" / "v1"
NAMES = sorted(path.name for path in GOLDEN.glob("*.csbrdf"))


@pytest.fixture(scope="session")
def sums():
    """CRC-32s by name: of the float32 values, the float64 values, the validity, and of source values."""
    lines = (GOLDEN / "hashes.txt").read_text().splitlines()
    return {line.split()[0]: line.split()[1:] for line in lines if line and line[0] != "#"}


@pytest.fixture(scope="session")
def independent():
    """spec/decode.py, written from the specification alone."""
    spec = importlib.util.spec_from_file_location("spec_decode", ROOT / "spec" / "decode.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
