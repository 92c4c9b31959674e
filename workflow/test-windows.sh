#!/usr/bin/env bash
# Tests a Windows build of trilink under Wine: the demo, a second run, a comparison with a baseline from another
# system, settings with backslashes, drive letters and CRLF, two runs at once, a killed run.
#   workflow/test-windows.sh trilink.exe
# It needs 64-bit Wine, on Debian:
#   apt-get install wine64 wine
# Before Wine 9, a bcryptprimitives.dll whose ProcessPrng calls SystemFunction036 must be beside the program.
set -euo pipefail

program=$(realpath "$1")
repository=$(cd "$(dirname "$0")/.." && pwd)
home=$(mktemp -d)
export WINEDEBUG=-all WINEPREFIX=$home/wine
trap 'wineserver -k || true; rm -rf "$home"' EXIT

trilink() { wine "$program" "$@" 2>error.txt >output.txt; }

# Prints the Windows name of a path of this machine.
windows_path() { echo "Z:${1//\//\\}"; }

expect() { # STATUS TEXT ARGUMENTS...: checks the exit status of a command and its output
    local needed=$1 text=$2 found=0
    shift 2
    trilink "$@" || found=$?
    if [ "$found" != "$needed" ] || ! cat output.txt error.txt | grep -qF -- "$text"; then
        echo "trilink $*: found status $found, needed $needed and \"$text\"" >&2
        cat output.txt error.txt >&2
        exit 1
    fi
    echo "ok: trilink $*"
}

# Prints the hash of all results that contain no time.
results() { find derived reports/figures -type f ! -name '*.json' ! -name .lock | sort | xargs cat | sha256sum; }

mkdir -p "$home/a b/project"
cd "$home/a b/project"
expect 0 "page: reports\\index.html" demo
expect 0 "everything was up to date" demo
undisturbed=$(results)
cp "$repository/docs/demo-baseline.json" .
expect 0 " 0 out of tolerance" compare demo-baseline.json

mkdir -p "$home/crlf/raw/day"
cd "$home/crlf"
cp "$home/a b/project/raw/demo/"* raw/day
sed 's/$/\r/' -i raw/day/trials.toml
sed -e 's#^raw = "raw/demo"#raw = '"'raw\\\\day'#" -e 's/^bootstrap = 200/bootstrap = 0/' -e 's/$/\r/' \
    "$repository/pipeline.toml" >pipeline.toml
expect 0 "page: reports\\index.html" run
expect 0 "cannot be ingested" check "$(windows_path "$PWD/raw/day")"
expect 0 "page: Z:" run -c "$(windows_path "$PWD/pipeline.toml")"
expect 0 "raw/day" inspect trials --columns folder --head 1

mkdir "$home/killed"
cd "$home/killed"
mkdir raw
cp -r "$home/a b/project/raw/demo" raw
wine "$program" demo >first.txt 2>&1 &
until [ -s derived/.lock ] && [ -e derived/poses ]; do sleep 0.2; done
expect 2 "held by" run
pkill -9 -f "${program##*/} demo"
wait || true
expect 0 "page: reports\\index.html" demo
[ "$(results)" = "$undisturbed" ] || { echo "a killed run left other results" >&2; exit 1; }
echo "ok: a run after a killed one gives the bytes of an undisturbed one"
