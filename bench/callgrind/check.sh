#!/usr/bin/env bash
# Counts the instructions of six kernels with callgrind and compares them with counts.txt, +-3 %: a
# regression check that noise cannot hide. Portable path, release build, the hull alone.
#
#   bench/callgrind/check.sh            compares; status 1 and a line for each kernel that is off
#   bench/callgrind/check.sh --update   writes the counts of this build
set -euo pipefail
cd "$(dirname "$0")/../.."

counts=bench/callgrind/counts.txt
kernels="inside nearest_edge normal_window exit touching index"
program="${CARGO_TARGET_DIR:-target}/release/kernel_counts"
update=""
case "${1:-}" in
    "") ;;
    --update) update=yes ;;
    *) echo "found $1, expected nothing or --update" >&2; exit 2 ;;
esac
if [ "$(uname -m)" != x86_64 ]; then
    echo "counts.txt is of x86_64, this is $(uname -m): nothing to compare"
    exit 0
fi
command -v valgrind >/dev/null || { echo "valgrind is not installed" >&2; exit 2; }

cargo build --release --locked --package kernels --bin kernel_counts
compiler="$(rustc --version)"

# Instructions in and below the function that calls the kernel.
count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null \
        --toggle-collect='kernel_counts::measured*' "$program" "$1" 2>&1 |
        sed -n 's/.*Collected : \([0-9][0-9]*\).*/\1/p'
}

found="$(mktemp)"
trap 'rm -f "$found"' EXIT
echo "# instructions, $compiler" >"$found"
for kernel in $kernels; do
    number="$(count "$kernel")"
    if [ -z "$number" ] || [ "$number" -eq 0 ]; then
        echo "$kernel: callgrind counted nothing" >&2
        exit 1
    fi
    echo "$kernel $number" >>"$found"
done

if [ -n "$update" ]; then
    cp "$found" "$counts"
    cat "$counts"
    exit 0
fi
off=0
awk '
    FNR == NR { if ($1 != "#") expected[$1] = $2; next }
    $1 == "#" { next }
    {
        change = ($1 in expected) ? 100 * ($2 / expected[$1] - 1) : 1e9
        far = change > 3 || change < -3
        printf "%-14s %12d instructions, %12d expected, %+.2f %%%s\n", $1, $2, expected[$1], change, far ? "  OFF" : ""
        bad = bad || far
    }
    END { exit bad }
' "$counts" "$found" || off=1
if [ "$off" -ne 0 ]; then
    before="$(sed -n 's/^# instructions, //p' "$counts")"
    if [ "$before" != "$compiler" ]; then echo "counts.txt is of $before, this is $compiler"; fi
    echo "meant? then: bench/callgrind/check.sh --update"
fi
exit "$off"
