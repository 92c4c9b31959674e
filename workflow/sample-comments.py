#!/usr/bin/env python3
"""Prints documentation comments drawn at random, each with the signature of its item.

    workflow/sample-comments.py SEED [COUNT]

For a reader who has not seen the code and judges each: understood at first reading, idiomatic English.
The draw depends on the seed and on the comments alone.
"""

import random
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COMMENT = re.compile(r"^\s*///")
ATTRIBUTE = re.compile(r"^\s*#\[")
PARENT = re.compile(r"^\s*(?:pub(?:\([a-z]+\))? )?(?:struct|enum|trait|impl\b|mod) ?.*")


def signature(lines, start):
    """The item from line `start` to its body or end, on one line."""
    text = ""
    for line in lines[start : start + 12]:
        text += " " + line.strip()
        if re.search(r"[{;,]\s*$", text) and text.count("(") == text.count(")"):
            break
    return re.sub(r"\s+", " ", text).strip().rstrip("{").strip()


def parent(lines, start):
    """The type or module around line `start`; empty at the top of a file."""
    indent = len(lines[start]) - len(lines[start].lstrip()) if start < len(lines) else 0
    for line in reversed(lines[:start]):
        if line.strip() and len(line) - len(line.lstrip()) < indent and PARENT.match(line):
            return f"in {line.strip().rstrip('{').strip()}: "
    return ""


def comments(path):
    """Yields (comment, signature) of every documented item of a file."""
    lines = path.read_text().splitlines()
    line = 0
    while line < len(lines):
        if not COMMENT.match(lines[line]):
            line += 1
            continue
        first = line
        while line < len(lines) and COMMENT.match(lines[line]):
            line += 1
        comment = "\n".join(re.sub(r"^\s*/// ?", "", text) for text in lines[first:line])
        while line < len(lines) and (ATTRIBUTE.match(lines[line]) or not lines[line].strip()):
            line += 1
        yield comment, parent(lines, line) + signature(lines, line)


def main():
    if not 2 <= len(sys.argv) <= 3 or not all(given.isdigit() for given in sys.argv[1:]):
        sys.exit(__doc__)
    seed, count = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 100
    listed = subprocess.run(
        ["git", "ls-files", "*.rs"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    found = [(name, *each) for name in listed.stdout.split() for each in comments(ROOT / name)]
    drawn = random.Random(seed).sample(found, min(count, len(found)))
    print(f"{len(drawn)} of {len(found)} comments, seed {seed}")
    for number, (name, comment, item) in enumerate(drawn, 1):
        print(f"\n[{number}] {name}\n{comment}\n    {item}")


if __name__ == "__main__":
    main()
