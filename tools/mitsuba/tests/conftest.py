import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
GOLDEN = ROOT / "tests" / "data" / "v1"
sys.path.insert(0, str(HERE.parent))
