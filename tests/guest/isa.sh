#!/bin/sh
# isa.sh [PIN [PASSES [LINES]]]: PASSES of mem, uio, lines. An ISA board in a guest, its firmware outside of it. Every function through /dev/mem and through UIO,
# compared with the same on a memory file; LINES command lines whose replies interrupts announce; no interrupt lost.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
pin=${1:-7}
passes=${2:-mem,uio}
lines=${3:-10000}

open_site "isa-$pin${KERNEL:+-$KERNEL}"
simulator
# shellcheck disable=SC2046 # words
boot isa 1 "pmac.passes=$passes pmac.lines=$lines" $(host_port)
bridge_edge "$pin"
guest_verdict
pulses

seen=$(value interrupts)
[ "$pulses" -ge "$lines" ] || fail "$lines lines, but the board gave only $pulses interrupts"
[ "$pulses" = "$seen" ] || fail "interrupts: the board gave $pulses, the guest saw $seen"
# Newer kernels count for UIO in a thread of their own, which may find two at once.
counted=$(value counted)
[ "$counted" -le "$seen" ] && [ "$counted" -ge $((seen * 9 / 10)) ] || fail "UIO counted $counted of $seen interrupts"
echo "$name: ok $pulses interrupts, none lost, $counted counted by UIO, $(value lines_per_second) lines a second"
# One end of interrupt (0x67, a g) for each, and one for each time the line was opened (0xE9 without bit 7, an i).
ends=$(tr -cd g <"$site/8259-command" | wc -c)
opened=$(tr -cd i <"$site/8259-mask" | wc -c)
[ "$ends" = $((pulses + opened)) ] || fail "the 8259 was sent $ends ends, for $pulses interrupts and a line opened $opened times"
[ "$(wc -c <"$site/8259-command")" = "$ends" ] || fail 'the 8259 was sent something else than ends of interrupt'
echo "$name: ok each was ended at the board's own controller"

# shellcheck disable=SC2046 # words
same_functions $(echo "$passes" | sed 's/lines//' | tr , ' ')
sed -n 's/^@@ latency //p' "$site/said" >"$cache/latency-$pin"
