#!/bin/sh
# isa.sh [PIN [PASSES [LINES]]]: an ISA board in a guest, its firmware outside of it. Every function through /dev/mem and through UIO,
# compared with the same on a memory file; LINES command lines whose replies interrupts announce; no interrupt lost.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
pin=${1:-7}
passes=${2:-mem,uio}
lines=${3:-10000}

open_site "isa-$pin"
simulator
# The two registers of the board's interrupt controller, as byte sinks: what the driver writes there is on file, and each end
# of an interrupt lets the next one come.
boot isa "$cache/initramfs.gz" 1 "pmac.passes=$passes pmac.lines=$lines" \
	-chardev "socket,id=command,path=$site/ends,server=on,wait=off,logfile=$site/8259-command" -device isa-debugcon,iobase=0x218,chardev=command \
	-chardev "file,id=mask,path=$site/8259-mask" -device isa-debugcon,iobase=0x219,chardev=mask
bridge "$pin" "$site/ends"
guest_verdict

# The simulator's end ends the bridge, which says how often it pulsed.
kill "$simulator"
wait "$bridge" || fail "the bridge: $(cat "$site/bridge")"
pulses=$(sed -n 's/^pulses=\([0-9]*\).*/\1/p' "$site/bridge")
seen=$(value interrupts)
[ "$pulses" -ge "$lines" ] || fail "$lines lines, but the board gave only $pulses interrupts"
[ "$pulses" = "$seen" ] || fail "interrupts: the board gave $pulses, the guest saw $seen"
echo "$name: ok $pulses interrupts, none lost, $(value lines_per_second) lines a second"
# One end of interrupt (0x67, a g) for each, and one for each time the device was opened.
ends=$(tr -cd g <"$site/8259-command" | wc -c)
opened=$(tr -cd i <"$site/8259-mask" | wc -c)
[ "$ends" = $((pulses + opened)) ] || fail "the 8259 was sent $ends ends of interrupt, $pulses interrupts came and the device was opened $opened times"
[ "$(wc -c <"$site/8259-command")" = "$ends" ] || fail "the 8259 was sent something else than ends of interrupt"
echo "$name: ok each was ended at the board's own controller"

for pass in $(echo "$passes" | tr , ' '); do
	sed -n "/^@@ begin functions-$pass/,/^@@ end functions-$pass/p" "$site/said" | sed '1d;$d' >"$site/functions-$pass"
	[ "$(wc -l <"$site/functions-$pass")" -gt 100 ] || fail "the functions through $pass: no results"
	diff -u "$cache/functions-file" "$site/functions-$pass" >&2 || fail "the functions through $pass give other results than on a memory file"
	echo "$name: ok functions through $pass, $(wc -l <"$site/functions-$pass") lines as on a memory file"
done
