"""Shares of the processor's samples within `crates/hull`, from a recording of perf.

    python3 bench/perf/shares.py target/release/hulltouch-bench perf.data

A sample belongs to the innermost line of crates/hull that addr2line names. The program needs its line tables:
docs/performance.md, "Contact passes beside OpenCV".
"""

import collections
import re
import subprocess
import sys

# Files of crates/hull/src by what they do; all others are projection, classes and the rest.
PARTS = {
    "search": ("probe/nearest_edge/", "view_set/edges", "view_set/beside"),
    "discs": ("probe/edge_line/", "view_set/planes"),
    "index": ("silhouette/",),
}


def output(*command, text=""):
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def part(symbol, frames):
    if "SilhouetteBuilder" in symbol:
        return "making silhouettes"
    files = (re.search(r"crates/hull/src/(.*)\.rs", frame) for frame in frames)
    file = next((found[1] for found in files if found and not found[1].startswith("vector")), "")
    return next((name for name, begins in PARTS.items() if file.startswith(begins)), "rest")


def main(program, recording):
    starts = {}
    for line in output("nm", "-C", program).splitlines():
        address, _, name = line.partition(" ")
        starts.setdefault(name[2:], address)
    samples = collections.Counter()
    for line in output("perf", "script", "-i", recording, "-F", "ip,sym,symoff").splitlines():
        found = re.match(r"\s*[0-9a-f]+ (hull::.*)\+0x([0-9a-f]+)$", line)
        if found and found[1] in starts:
            samples[found[1], int(starts[found[1]], 16) + int(found[2], 16)] += 1
    addresses = "".join(f"{address:#x}\n" for _, address in samples)
    named = output("addr2line", "-e", program, "-i", "-a", text=addresses)
    shares = collections.Counter()
    for block, ((symbol, _), count) in zip(re.split(r"^0x", named, flags=re.M)[1:], samples.items()):
        shares[part(symbol, block.splitlines()[1:])] += count
    shares.pop("making silhouettes", None)
    total = sum(shares.values())
    print(f"{total} samples:", ", ".join(f"{name} {100 * count / total:.0f} %" for name, count in shares.most_common()))


if __name__ == "__main__":
    main(*sys.argv[1:])
