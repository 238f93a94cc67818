#!/bin/sh
# lockdown.sh [LINES]: what a locked-down kernel refuses is told as such, and what it allows is enough for a board.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
lines=${1:-500}

open_site lockdown
simulator
# shellcheck disable=SC2046 # words
boot lockdown "$cache/initramfs.gz" 1 "pmac.lines=$lines" -device edu $(host_port)
bridge_edge 7
guest_verdict
[ "$(value interrupts)" -ge "$lines" ] || fail "$lines lines, but only $(value interrupts) interrupts"
echo "$name: ok $(value interrupts) interrupts on a locked-down kernel"
