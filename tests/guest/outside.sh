#!/bin/sh
# outside.sh RESULT: the functions on a memory file, without a guest: what the guests' results are compared with.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
open_site outside
simulator
background daemon "$programs/pmacd" --board "file:$site/dpram,irq=unix:$site/irq" --name "pmac-guest-$$" --socket "$site/socket"
pmacctl="$programs/pmacctl --name pmac-guest-$$ --socket $site/socket"
wait_for 10 'live servo data' $pmacctl motors
"$here/functions.sh" "$site" $pmacctl >"$site/result"
mv "$site/result" "$1"
[ ! -x "$cache/latency" ] || "$cache/latency" "pmac-guest-$$" "$site/socket" 1000 'file, by interrupt' >"$cache/latency-file"
echo "$name: ok functions on a memory file, $(wc -l <"$1") lines"
