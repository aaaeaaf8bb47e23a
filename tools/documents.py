#!/usr/bin/env python3
"""Runs the commands of the documents as they are written, page by page, each page in a folder of its own.

    tools/documents.py sh TOOL               # the blocks `sh` of README.md, docs/guide and the bindings, with TOOL as csbrdf
    tools/documents.py python TOOL PYTHON    # the blocks `python`, by an interpreter that has the package
    tools/documents.py c CC                  # the blocks `c` are compiled, not linked
    tools/documents.py sh TOOL damage.md     # one page

Blocks `sh` of a page run in one shell, in their order, blocks `python` each by itself beside satin-paint.csbrdf. A block after a comment
`<!-- not run: WHY -->` is left out, and said. Rust blocks are doc tests of the library (src/documents.rs).
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs" / "guide").glob("*.md"))]
PAGES += [ROOT / "tools" / part / "README.md" for part in ("capi", "python", "mitsuba")]
BLOCK = re.compile(r"(?:^<!-- not run: (?P<why>[^\n]*) -->\n+)?^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.M | re.S)
# What pages of bindings find in their folder.
MADE = "csbrdf synth satin-paint --noise 0.003 -q && csbrdf encode satin-paint.binary --lossless -q"


def blocks(page, language):
    """The texts of the page's blocks in a language; those left out are named."""
    for found in BLOCK.finditer(page.read_text()):
        if found["language"] != language:
            continue
        if found["why"]:
            print(f"  {page.relative_to(ROOT)}: a block {language} is not run: {found['why']}")
        else:
            yield found["text"]


def programs(page, language, program):
    """What is run for a page: a command and its standard input each."""
    texts = list(blocks(page, language))
    if language == "sh":
        return [(["bash", "-eo", "pipefail"], "\n".join(texts))] if texts else []
    if language == "python":
        return [([program, "-"], text) for text in texts]
    if language == "c":
        include = ROOT / "tools" / "capi" / "include"
        checked = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{include}", "-fsyntax-only", "-xc", "-"]
        return [([program, *checked], text) for text in texts]
    sys.exit(f"blocks {language} cannot be run, only sh, python and c")


def run(page, language, tool, program):
    """Runs the blocks of a page in a new folder; how many failed."""
    failed = 0
    parts = programs(page, language, program)
    with tempfile.TemporaryDirectory() as folder:
        bin, work = Path(folder) / "bin", Path(folder) / "work"
        bin.mkdir()
        work.mkdir()
        environment = {**os.environ, "PATH": f"{bin}:{os.environ['PATH']}"}
        if tool:
            (bin / "csbrdf").symlink_to(Path(tool).resolve())
        if parts and language == "python":
            subprocess.run(["bash", "-c", MADE], cwd=work, env=environment, check=True)
        for command, text in parts:
            start = time.monotonic()
            done = subprocess.run(command, input=text, cwd=work, env=environment, text=True, capture_output=True)
            print(f"  {page.relative_to(ROOT)}, {language}: {time.monotonic() - start:.1f} s, status {done.returncode}")
            if done.returncode:
                failed += 1
                print(done.stdout[-2000:], done.stderr[-4000:], sep="\n")
    return failed


def main(language, program, *rest):
    tool = None if language == "c" else program
    if language == "python":
        program, *rest = rest
    if program and "/" in program:
        # A block runs in a folder of its own; a link stays one, or it would be the interpreter without its packages.
        program = os.path.abspath(program)
    pages = [page for page in PAGES if not rest or str(page.relative_to(ROOT)).endswith(tuple(rest))]
    failed = [str(page.relative_to(ROOT)) for page in pages if run(page, language, tool, program)]
    if failed:
        sys.exit(f"documents whose blocks {language} fail: {', '.join(failed)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
