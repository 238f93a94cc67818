#!/bin/sh
# lockdown.sh [LINES]: what a locked-down kernel refuses is told as such, and what it allows is enough for a board. This board is one that
# the machine's firmware describes (ACPI), and its interrupt is a level.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
lines=${1:-500}

open_site lockdown
simulator
iasl -p "$site/board" "$here/board.asl" >"$site/iasl" 2>&1 || fail "$(cat "$site/iasl")"
# shellcheck disable=SC2046 # words
boot lockdown 1 "pmac.lines=$lines" -acpitable "file=$site/board.aml" -device edu $(host_port)
pin='set_irq_in /machine/i440fx/ioapic unnamed-gpio-in 7'
bridge "$pin 1" "$pin 0" "served:$site/dpram"
guest_verdict
[ "$(value interrupts)" -ge "$lines" ] || fail "$lines lines, but only $(value interrupts) interrupts"
echo "$name: ok $(value interrupts) interrupts on a locked-down kernel"
