#!/bin/sh
# Geo-tag every new flight folder, once, and gate the result. Made for cron:
#
#   30 2 * * *  MAP=/srv/maps/area.tif HFOV=45 /opt/uasthn/geotag_nightly.sh /srv/flights /srv/results
#
# A flight is a folder FLIGHTS/NAME with flight.tlog and frames/ (its own map.tif, if there, goes
# before MAP). Results go to RESULTS/NAME, figures to RESULTS/NAME.report.json, everything that is
# said to RESULTS/nightly.log. A flight counts as done when its figures are there; remove them and
# RESULTS/NAME to have it done again. A run that was cut off goes on where it stopped on the next
# night, one that failed is tried again.
#
# From the environment: MAP, HFOV or CAMERA (see `uasthn cameras`), SEARCH_RADIUS_M (200),
# MIN_ACCEPTED (0.5), SETTLE_MIN (10: minutes without change before an upload counts as
# complete), UASTHN (the program).
#
# Exit code: 0 all well; 4 a flight missed its gates; 1 a flight could not be geo-tagged;
# 2 wrong usage; 75 another run is still at it (EX_TEMPFAIL of sysexits.h).

set -eu

usage() {
    echo "usage: MAP=area.tif HFOV=45 $0 FLIGHTS RESULTS" >&2
    exit 2
}

[ $# -eq 2 ] || usage
flights=$1
results=$2
[ -d "$flights" ] || usage

uasthn=${UASTHN:-uasthn}
search_radius_m=${SEARCH_RADIUS_M:-200}
min_accepted=${MIN_ACCEPTED:-0.5}
settle_min=${SETTLE_MIN:-10}

mkdir -p "$results"
log=$results/nightly.log

say() {
    printf '%s %s\n' "$(date -u +%Y-%m-%dT%H:%M:%SZ)" "$*" >>"$log"
}

exec 9>"$results/.nightly.lock"
if ! flock -n 9; then
    say "another run is still at it"
    exit 75
fi

# Tell whether nothing in a folder changed within the last minutes.
settled() {
    [ -z "$(find "$1" -mmin "-$settle_min" -print | head -n 1)" ]
}

# Geo-tag one flight; the arguments of the camera are what is left in "$@".
geotag() {
    flight=$1
    out=$2
    map=$flight/map.tif
    [ -f "$map" ] || map=${MAP:-}
    if [ -z "$map" ]; then
        say "$flight: no map.tif in it and MAP is not set"
        return 1
    fi
    set -- --map "$map" --search-radius "$search_radius_m" --out "$out"
    if [ -n "${CAMERA:-}" ]; then
        set -- "$@" --camera "$CAMERA"
    elif [ -n "${HFOV:-}" ]; then
        set -- "$@" --hfov "$HFOV"
    fi
    "$uasthn" geotag "$flight/flight.tlog" "$flight/frames" "$@" >>"$log" 2>&1
}

failed=0
missed=0
for flight in "$flights"/*/; do
    flight=${flight%/}
    name=${flight##*/}
    figures=$results/$name.report.json
    if [ ! -f "$flight/flight.tlog" ] || [ ! -d "$flight/frames" ] || [ -f "$figures" ]; then
        continue
    fi
    if ! settled "$flight"; then
        say "$name: still being copied, left for the next night"
        continue
    fi

    code=0
    if [ ! -f "$results/$name/run.json" ]; then
        say "$name: geo-tagging"
        geotag "$flight" "$results/$name" || code=$?
    fi
    if [ "$code" -ne 0 ]; then
        say "$name: failed with exit code $code"
        failed=1
        continue
    fi

    "$uasthn" report "$results/$name" --json --min-accepted "$min_accepted" \
        >"$figures.part" 2>>"$log" || code=$?
    if [ "$code" -ne 0 ] && [ "$code" -ne 4 ]; then
        rm -f "$figures.part"
        say "$name: no report, exit code $code"
        failed=1
        continue
    fi
    mv "$figures.part" "$figures"
    if [ "$code" -eq 4 ]; then
        say "$name: gates missed"
        missed=1
    else
        say "$name: done"
    fi
done

[ "$failed" -eq 0 ] || exit 1
[ "$missed" -eq 0 ] || exit 4
